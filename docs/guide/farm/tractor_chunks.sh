#!/bin/bash
# Writes a shot as a job of Tractor: tasks that follow each other, each with a chunk of the frames and a log of its own.
#
#   tractor_chunks.sh NAME FRAMES OUT SCENE FIRST-LAST [arguments of `drapery run`, but for --frames and --out] >shot.alf
#   tractor-spool shot.alf
#
# FRAMES is the number of frames in a chunk. A task starts when the one before it is done, and resumes from the checkpoint at its end.
# Tractor starts a task again by itself that stopped (75) or lost a rank (69), had too little memory (71) or a fault in itself (70).
#
# DRAPERY names the program if it is not in the PATH.
set -euo pipefail
# shellcheck source=frame_chunks.sh
source "$(dirname "$0")/frame_chunks.sh"

# Words as Tcl reads them, each in braces.
words() {
    [[ $* != *[{}\\]* ]] || {
        echo "tractor_chunks.sh: braces and backslashes cannot be passed on: $*" >&2
        exit 2
    }
    printf '{%s} ' "$@"
}

title=$(words "$name cloth")
echo "Job -title $title-serialsubtasks 1 -subtasks {"
while read -r from to; do
    # Every chunk asks for all frames up to its end: a finished range is extended, and nothing is simulated twice.
    command=$(words "${DRAPERY:-drapery}" run "$scene" --frames "${chunks%% *}-$to" --out "$out" --progress tr "$@")
    echo "    Task {$from-$to} -cmds {"
    echo "        RemoteCmd {${command% }} -service {PixarRender} -retryrc {69 70 71 75}"
    echo "    }"
done <<<"$chunks"
echo "}"
