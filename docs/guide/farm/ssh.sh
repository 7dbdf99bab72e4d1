#!/bin/bash
# Runs a shot over ssh on one of several machines, the next one when a machine fails. A farm without a scheduler.
#
#   ssh.sh "HOST..." OUT SCENE [arguments of `drapery run`, but for --out]
#
# All machines have this folder, OUT and the inputs under the same paths, and let ssh in without a password.
#
# * 75: the next attempt follows on the same machine. After a signal to this script, which makes `drapery stop` of it, or after `drapery
#   stop` itself, the script ends with 75.
# * A machine that ssh does not reach or loses (255), and a run that was killed (128 and above), lost a rank (69), found too little
#   memory (71) or a fault in itself (70): the next attempt follows on the next machine.
# * A lost machine may still work on the shot. Its run is waited for as long as its lock is alive, then taken over.
# * Every other exit code is passed on; so is the last one after 20 attempts.
#
# DRAPERY names the program on all machines if it is not in the PATH.
set -u
drapery=${DRAPERY:-drapery}
read -r -a hosts <<<"${1:?usage: ssh.sh \"HOST...\" OUT SCENE [arguments of drapery run]}"
out=${2:?usage: ssh.sh \"HOST...\" OUT SCENE [arguments of drapery run]}
shift 2
most_attempts=20

run= told= noticed=
stop() {
    told=1 noticed=1
    "$drapery" stop "$out" >/dev/null 2>&1
}
trap stop TERM INT HUP

# What `drapery status` prints of the folder; nothing before the first run.
status() {
    "$drapery" status "$out" --json 2>/dev/null
}

code=75 turn=0
for ((attempt = 1; attempt <= most_attempts; attempt++)); do
    # The run of a lost machine: its heartbeat comes every ten seconds, and after three minutes without one it is silent.
    while [[ -z $told && $(status) == *'"presence":"alive"'* ]]; do sleep 5; done
    [ -z "$told" ] || exit 75
    steal=()
    [[ $(status) != *'"presence":"silent"'* ]] || steal=(--steal-lock)
    host=${hosts[turn % ${#hosts[@]}]}
    command=$(printf '%q ' cd "$PWD")"&& "$(printf '%q ' "$drapery" run "$@" --out "$out" "${steal[@]}")
    echo "ssh.sh: attempt $attempt on $host" >&2
    ssh -o BatchMode=yes -o ConnectTimeout=10 -o ServerAliveInterval=15 "$host" "$command" </dev/null &
    run=$!
    # A signal to this script ends `wait` early; then it is asked again, since the run goes on to its checkpoint.
    while :; do
        noticed=
        wait "$run"
        code=$?
        [ -n "$noticed" ] || break
        # A request that comes before the run has its folder is lost; so it is repeated.
        while kill -0 "$run" 2>/dev/null; do
            stop
            sleep 1
        done
    done
    case $code in
    75) [[ $(status) != *'"end":"control/stop"'* ]] || exit 75 ;;
    69 | 70 | 71) turn=$((turn + 1)) ;;
    *)
        [ "$code" -ge 128 ] || exit "$code"
        turn=$((turn + 1))
        ;;
    esac
done
exit "$code"
