# The two commands of the README are `make demo` and `make test`; `make help` lists the others.

SHELL := /bin/bash
.DEFAULT_GOAL := help

QUALITY ?= light
TARGET := $(abspath $(or $(CARGO_TARGET_DIR),target))
# What the commands are built with. USD stands on a crate that asks for Rust 1.96 and is content with 1.95 (docs/dev/decisions/0018-usd.md).
FEATURES := --features drapery/mpi,drapery/usd --ignore-rust-version
export DRAPERY := $(TARGET)/release/drapery
export DRAPERY_ASSETS := $(TARGET)/release/drapery-assets
export DRAPERY_BARE := $(TARGET)/bare
export DRAPERY_MICRO_SCENE := $(TARGET)/release/examples/micro_scene
export DRAPERY_CONFORMANCE := $(TARGET)/release/examples/conformance
export DRAPERY_USD_POINTS := $(TARGET)/release/examples/usd_points

.PHONY: help
help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-14s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

.PHONY: setup
setup: ## install what is missing: Debian packages and the Python environment .venv
	@.ci/setup.sh

.PHONY: build
build: setup ## release build of the commands, their debug tables beside them in *.debug
	cargo build --release --workspace $(FEATURES)
	@packaging/split-debug.sh $(DRAPERY) $(DRAPERY_ASSETS)

.PHONY: demo
demo: build ## simulate a dressed character and render six frames of it; QUALITY=full for the fine garments
	@sample_assets/demo.sh $(QUALITY)

.PHONY: test
test: build ## Rust tests, then the outside judges (Alembic's own reader, Blender, h5py, libigl), then the Python wheel
	cargo test --release --workspace $(FEATURES)
	@packaging/split-debug.sh $(DRAPERY) $(DRAPERY_ASSETS)
	$(TARGET)/release/examples/write_demo $(TARGET)/alembic_demo
	DRAPERY_ALEMBIC_DEMO=$(TARGET)/alembic_demo .venv/bin/python -m pytest tests/oracle --numprocesses 2 --dist loadfile --no-loadscope-reorder
	@.ci/test-python.sh

.PHONY: test-python
test-python: build ## the tests of the Python wheel alone
	@.ci/test-python.sh

.PHONY: dist
dist: build ## what is given away: archive of the command, package for C, Python wheel, with checksums; tried in empty folders
	@packaging/dist.sh $(TARGET)/dist
	@packaging/test-dist.sh $(TARGET)/dist

.PHONY: docs
docs: setup ## the book, with rustdoc beside it, in target/book; links that lead nowhere are errors
	@tools/docs/build.sh $(TARGET)/book

.PHONY: test-full
test-full: build bare ## the suites too long for CI, or those that ONLY selects; writes docs/dev/measurements/test-full.md
	@tests/full.sh "$(ONLY)"

.PHONY: bare
bare: setup ## builds with and without the optional effects, which the proof that absent ones are free compares
	@tests/build-bare.sh "$(TARGET)"

.PHONY: compare
compare: build ## that results have the bytes of an earlier commit, on threads, ranks and after a stop: BASE=COMMIT
	@.venv/bin/python -m measure.compare $(BASE)

SECONDS_EACH ?= 600

.PHONY: fuzz
fuzz: setup ## fuzz every reader, SECONDS_EACH (600) seconds each; TARGETS="obj scene" for some of them
	@tests/fuzz/run.sh $(SECONDS_EACH) $(TARGETS)

.PHONY: bench
bench: setup ## benches of the solver's parts
	@cp Cargo.lock core/benches/Cargo.lock
	cargo bench --manifest-path core/benches/Cargo.toml --target-dir $(TARGET)

.PHONY: measure
measure: build ## NAME=speed measures it and writes its page, MEASURE="--rows hung_5k" some of its rows (--list names them); names alone where NAME is left out
	@.venv/bin/python -m measure $(NAME) $(MEASURE)

.PHONY: figures
figures: setup ## the figures of the pages of theory, in docs/pictures: those drawn, and those that the solver computes
	@python3 tools/docs/figures.py
	DRAPERY_BLESS=1 cargo test --release --package drapery-core --lib figure
	DRAPERY_BLESS=1 cargo test --release --package drapery-tests --test physics amplification

.PHONY: pictures
pictures: build ## simulate the scenes of the how-to pages and render docs/pictures/howto; ONLY="cape flag" for some, ONLY=sheet for the sheet alone
	@.venv/bin/python tools/docs/pictures.py --drapery $(DRAPERY) --assets-program $(DRAPERY_ASSETS) --work $(TARGET)/pictures $(ONLY)

CHECKOUT ?= .
.PHONY: structure
structure: ## rooms of the solver, imports between them, circles; CHECKOUT=DIR for another one
	@cargo run --release --quiet --package drapery-tests --example structure -- $(CHECKOUT)

.PHONY: lint
lint: setup ## formatting and lints, as CI checks them
	cargo fmt --all --check
	cargo clippy --release --workspace --all-targets $(FEATURES) -- -D warnings
	cargo clippy --release --package drapery --no-default-features -- -D warnings
	@cp Cargo.lock core/benches/Cargo.lock
	cargo clippy --release --manifest-path core/benches/Cargo.toml --target-dir $(TARGET) --all-targets -- -D warnings
