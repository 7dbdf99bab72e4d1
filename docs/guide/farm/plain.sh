#!/bin/bash
# Runs a shot until it is done, on a machine without a scheduler or as the command of one.
#
#   plain.sh OUT SCENE [arguments of `drapery run`, but for --out]
#
# * An attempt that used up its --max-wall, or whose process was told to stop by somebody else, is followed by the next.
# * A signal to this script goes to the run, which writes a checkpoint; then both end, with exit code 75.
# * `drapery stop OUT` ends the run and this script, with exit code 75.
# * A lock whose owner has been silent for minutes on another machine is taken over. Use this script only where one
#   process at a time works in OUT; a lock that is alive is never touched (exit code 73).
# * Every other exit code is passed on.
#
# DRAPERY names the program if it is not in the PATH.
set -u
drapery=${DRAPERY:-drapery}
out=${1:?usage: plain.sh OUT SCENE [arguments of drapery run]}
shift

run= told= noticed=
pass_on() {
    told=1 noticed=1
    # Before the run has started there is nobody to tell.
    [ -z "$run" ] || kill -s "$1" "$run" 2>/dev/null
}
for signal in TERM INT HUP USR1 USR2 XCPU; do
    # The name is wanted as it is now.
    # shellcheck disable=SC2064
    trap "pass_on $signal" "$signal"
done

code=75
while [ -z "$told" ]; do
    steal=()
    if "$drapery" status "$out" --json 2>/dev/null | grep -q '"presence":"silent"'; then
        steal=(--steal-lock)
    fi
    "$drapery" run "$@" --out "$out" "${steal[@]}" &
    run=$!
    # A signal to this script ends `wait` early; then it is asked again.
    while :; do
        noticed=
        wait "$run"
        code=$?
        [ -n "$noticed" ] || break
    done
    run=
    [ "$code" -eq 75 ] || exit "$code"
    # Why the run stopped stands in the last line of the log of this attempt.
    log=$(ls "$out"/logs/*.log | tail -n 1)
    case $(tail -n 1 "$log") in
    *"stopped (max-wall)"* | *"stopped (signal "*) ;;
    *) exit 75 ;;
    esac
done
exit "$code"
