#!/bin/bash
# Fuzzes every reader (docs/dev/fuzzing.md), one target after the other, on one core each.
#
#     tests/fuzz/run.sh SECONDS [TARGET...]     seconds of each target; all targets where none is named
#
# The inputs under tests/fuzz/corpus are run first, then changed ones for the time that is left. What makes a reader fail is
# kept in $CARGO_TARGET_DIR/fuzz/failures, and new inputs that reach new code in $CARGO_TARGET_DIR/fuzz/corpus.
set -euo pipefail
cd "$(dirname "$0")/../.."

seconds=$1
shift
targets=("$@")
[ ${#targets[@]} -gt 0 ] || targets=(alembic usd usd_cache obj scene checkpoint hdf5_cache run_folder)

root=${CARGO_TARGET_DIR:-target}/fuzz
mkdir -p "$root"
root=$(cd "$root" && pwd)
host=$(rustc -vV | sed -n 's/^host: //p')

# Instrumentation that libFuzzer follows, by options of the stable compiler; `fuzzing` keeps generated garments small.
flags="--cfg fuzzing -C passes=sancov-module"
for option in level=4 inline-8bit-counters pc-table trace-compares; do
    flags+=" -C llvm-args=-sanitizer-coverage-$option"
done
case $host in x86_64-*) flags="-C target-cpu=x86-64-v3 $flags" ;; esac
# What is fuzzed are the versions that are shipped; cargo adds libFuzzer to them.
cp Cargo.lock tests/fuzz/libfuzzer/Cargo.lock
# With --target the flags stay away from build scripts.
(cd tests/fuzz/libfuzzer && RUSTFLAGS=$flags CARGO_TARGET_DIR=$root cargo build --release --quiet --ignore-rust-version --target "$host")
bin=$root/$host/release

export RAYON_NUM_THREADS=1
failed=()
for target in "${targets[@]}"; do
    mkdir -p "$root/corpus/$target" "$root/failures/$target"
    inputs=("$root/corpus/$target" "tests/fuzz/corpus/$target")
    [ "$target" != scene ] || inputs+=(sample_assets/scenes tests/scenes)
    options=(-max_total_time="$seconds" -timeout=60 -rss_limit_mb=2048 -max_len=16384 -print_final_stats=1 -verbosity=1
        -artifact_prefix="$root/failures/$target/")
    [ ! -f "tests/fuzz/dictionaries/$target.dict" ] || options+=(-dict="tests/fuzz/dictionaries/$target.dict")
    echo "== $target: $seconds s"
    "$bin/$target" "${options[@]}" "${inputs[@]}" >"$root/$target.log" 2>&1 &
    fuzzer=$!
    if ! wait $fuzzer; then
        failed+=("$target")
        tail -n 40 "$root/$target.log" | sed 's/^/    /'
    fi
    rm -rf "/dev/shm/drapery-fuzz-$fuzzer"
    grep -E '^(stat::number_of_executed_units|stat::peak_rss_mb)|DONE' "$root/$target.log" || true
done
if [ ${#failed[@]} -gt 0 ]; then
    echo "fuzz: these readers failed: ${failed[*]}; the inputs are under $root/failures" >&2
    exit 1
fi
