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
	@.ci/setup

.PHONY: build
build: setup ## release build of the commands, their debug tables beside them in *.debug
	cargo build --release --workspace $(FEATURES)
	@.ci/split-debug $(DRAPERY) $(DRAPERY_ASSETS)

.PHONY: demo
demo: build ## simulate a dressed character and render six frames of it; QUALITY=full for the fine garments
	@.ci/demo $(QUALITY)

.PHONY: test
test: build ## Rust tests, then the outside judges (Alembic's own reader, Blender, h5py, libigl), then the Python wheel
	cargo test --release --workspace $(FEATURES)
	@.ci/split-debug $(DRAPERY) $(DRAPERY_ASSETS)
	$(TARGET)/release/examples/write_demo $(TARGET)/alembic_demo
	DRAPERY_ALEMBIC_DEMO=$(TARGET)/alembic_demo .venv/bin/python -m pytest tests/oracle --numprocesses 2 --dist loadfile --no-loadscope-reorder
	@.ci/test-python

.PHONY: test-python
test-python: build ## the tests of the Python wheel alone
	@.ci/test-python

.PHONY: dist
dist: build ## what is given away: archive of the command, package for C, Python wheel, with checksums; tried in empty folders
	@.ci/dist $(TARGET)/dist
	@.ci/test-dist $(TARGET)/dist

.PHONY: docs
docs: setup ## the book, with rustdoc beside it, in target/book; links that lead nowhere are errors
	@.ci/docs $(TARGET)/book

.PHONY: test-full
test-full: build bare ## the suites too long for CI, or those that ONLY selects; writes docs/dev/measurements/test-full.md
	@.ci/test-full "$(ONLY)"

.PHONY: bare
bare: setup ## builds with and without the optional effects, which the proof that absent ones are free compares
	@.ci/build-bare "$(TARGET)"

.PHONY: compare
compare: build ## that results have the bytes of an earlier commit, on threads, ranks and after a stop: BASE=COMMIT
	@.ci/compare-results $(BASE)

SECONDS_EACH ?= 600

.PHONY: fuzz
fuzz: setup ## fuzz every reader, SECONDS_EACH (600) seconds each; TARGETS="obj scene" for some of them
	@.ci/fuzz $(SECONDS_EACH) $(TARGETS)

.PHONY: bench
bench: setup ## benches of the solver's parts
	@cp Cargo.lock core/benches/Cargo.lock
	cargo bench --manifest-path core/benches/Cargo.toml --target-dir $(TARGET)

.PHONY: measure
measure: build ## what self-contact costs, on the spinning ball and the twister; writes docs/dev/measurements/self-contact.md
	@.ci/measure-self-contact $(MEASURE)

.PHONY: measure-ranks
measure-ranks: build ## what many ranks cost and bring, on the spinning ball; writes docs/dev/measurements/ranks.md
	@.ci/measure-ranks $(MEASURE)

.PHONY: accuracy
accuracy: build ## what repulsion with history, both integrators, the presets and friction cost and bring; writes docs/dev/measurements/accuracy.md
	@.venv/bin/python .ci/measure-accuracy $(MEASURE)

.PHONY: measure-speed
measure-speed: build ## how much faster it is than commit 336fa90; writes docs/dev/measurements/speed.md; MEASURE="--rows NAME,NAME" for some rows
	@.ci/measure-speed $(MEASURE)

.PHONY: measure-plan
measure-plan: build ## how far the cost that `drapery plan` expects is from that of simulated frames; writes docs/dev/measurements/speed.md
	@.ci/measure-plan $(MEASURE)

.PHONY: study
study: build ## what accuracy costs in time on the spinning ball and the dressed mannequin; writes docs/dev/measurements/studies.md
	@.venv/bin/python .ci/measure-study $(MEASURE)

.PHONY: measure-symptoms
measure-symptoms: build ## tries the remedies of docs/guide/troubleshooting.md, before and after; writes its table
	@.venv/bin/python .ci/measure-symptoms $(MEASURE)

.PHONY: figures
figures: setup ## the figures of the pages of theory, in docs/pictures: those drawn, and those that the solver computes
	@python3 .ci/figures
	DRAPERY_BLESS=1 cargo test --release --package drapery-core --lib figure
	DRAPERY_BLESS=1 cargo test --release --package drapery-tests --test physics amplification

.PHONY: pictures
pictures: build ## simulate the scenes of the how-to pages and render docs/pictures/howto; ONLY="cape flag" for some, ONLY=sheet for the sheet alone
	@.venv/bin/python .ci/pictures --drapery $(DRAPERY) --assets-program $(DRAPERY_ASSETS) --work $(TARGET)/pictures $(ONLY)

CHECKOUT ?= .
.PHONY: structure
structure: ## rooms of the solver, imports between them, circles; CHECKOUT=DIR for another one
	@cargo run --release --quiet --package drapery-tests --example structure -- $(CHECKOUT)

.PHONY: build-times
build-times: setup ## how long builds take, from nothing and after a change in each crate; CHECKOUT=DIR for another one
	@.ci/measure-build-times $(CHECKOUT)

.PHONY: lint
lint: setup ## formatting and lints, as CI checks them
	cargo fmt --all --check
	cargo clippy --release --workspace --all-targets $(FEATURES) -- -D warnings
	cargo clippy --release --package drapery --no-default-features -- -D warnings
	@cp Cargo.lock core/benches/Cargo.lock
	cargo clippy --release --manifest-path core/benches/Cargo.toml --target-dir $(TARGET) --all-targets -- -D warnings
