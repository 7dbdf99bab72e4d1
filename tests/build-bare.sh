#!/bin/bash
# Builds what the proof that absent effects are free compares (tests/oracle/test_absent_effects.py): the command without the
# optional effects, and the micro-scene with all of them and with none. Called by `make bare`. Argument: the target folder.
set -euo pipefail
cd "$(dirname "$0")/.."

target=$1
bare=$target/bare
mkdir -p "$bare"

cargo build --release --package drapery --no-default-features --target-dir "$bare/build_command"
cp "$bare/build_command/release/drapery" "$bare/drapery"

# For any x86-64, in folders of their own: valgrind does not know all of what a newer processor could do. In one unit:
# how a crate is cut into several depends on all that is in it, and what is inlined on the cut, which is no cost of an effect.
# One unit is compiled on one core: both at once.
micro_scene() {
    local folder=$bare/build_$1
    RUSTFLAGS="-C target-cpu=x86-64 -C codegen-units=1" cargo build --release --package drapery-core --example micro_scene --target-dir "$folder" "${@:2}"
    cp "$folder/release/examples/micro_scene" "$bare/micro_scene_$1"
}
micro_scene none --no-default-features &
micro_scene all
wait $!
