#!/bin/bash
# Takes the debug tables out of programs and puts them beside, as PROGRAM.debug: the program is a fifth as long, and perf, gdb
# and backtraces (RUST_BACKTRACE=1) still find lines, as long as both files lie in one folder. Called by `make build`.
set -euo pipefail

for program in "$@"; do
    # Done already; cargo puts the one with tables back whenever it builds.
    ! objdump --section-headers "$program" | grep -q '\.debug_line' && continue
    folder=$(mktemp -d "$program.XXXXXX")
    # The link holds the name of the file with the tables, and a sum of its content.
    tables=$folder/$(basename "$program").debug
    objcopy --only-keep-debug --compress-debug-sections=zlib "$program" "$tables"
    objcopy --strip-debug --add-gnu-debuglink="$tables" "$program" "$folder/program"
    mv "$tables" "$program.debug"
    mv "$folder/program" "$program"
    rmdir "$folder"
done
