#!/bin/bash
# The suites too long for CI, or the tests of them that the first argument selects. Keeps what they found in docs/dev/measurements/test-full.md.
# Called by `make test-full`, which has built the commands. Stopped and called again, its long shots go on where they were:
# they are kept by the state of the solver that simulates them.
set -euo pipefail
cd "$(dirname "$0")/.."

# Digest of the sources of `core` that are committed, without its tests and benches and without lines that are comments.
skipped=()
for name in tests tests.rs benches examples; do skipped+=("--exclude=$name"); done
solver=$({ git archive HEAD core | tar -xO "${skipped[@]}" | sed '/^ *\/\//d' | git hash-object --stdin; } 2>/dev/null | cut -c1-7) || true
export DRAPERY_LONG_RUNS=${DRAPERY_LONG_RUNS:-target/long-runs/$solver}
mkdir -p "$DRAPERY_LONG_RUNS"

# Slurm, Tcl in which jobs of Tractor are written, and what makes images.
.ci/setup.sh slurm-wlm munge tcl mmdebstrap buildah
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
schedulers=$target/schedulers
requirements=tests/oracle/scheduler_requirements.txt
if ! cmp -s "$requirements" "$schedulers/installed.txt"; then
    .venv/bin/python -m venv --clear "$schedulers"
    "$schedulers/bin/python" -m pip install --quiet --disable-pip-version-check --requirement "$requirements"
    cp "$requirements" "$schedulers/installed.txt"
fi
export DRAPERY_SCHEDULERS=$schedulers/bin

# Names of tests as pytest selects them; all when empty.
only=${1:-}
log=$(mktemp)
trap 'rm -f "$log"' EXIT
status=0
if [ -z "$only" ]; then
    cargo test --release --workspace -- --ignored 2>&1 | tee "$log" || status=1
fi
[ -n "$only" ] || tests/fuzz/run.sh 60 2>&1 | tee -a "$log" || status=1
.venv/bin/python -m pytest tests/oracle -m full -rap -k "$only" 2>&1 | tee -a "$log" || status=1

.venv/bin/python -m measure.long_tests "$log" "$(basename "$DRAPERY_LONG_RUNS")" "$([ -n "$only" ] || echo all)"
exit $status
