# Arguments of scripts that split a shot into chunks of frames, which source this file:
#
#   NAME FRAMES OUT SCENE FIRST-LAST [arguments of `drapery run`]
#
# Sets name, out, scene and chunks: the first and the last frame of each chunk of FRAMES frames, one chunk a line. Leaves the arguments
# of `drapery run`.

# frame_chunks FRAMES FIRST-LAST: the chunks.
frame_chunks() {
    [[ $1 =~ ^[1-9][0-9]*$ && $2 =~ ^(-?)([0-9]+)-(-?)([0-9]+)$ ]] || {
        echo "$0: FRAMES is a number above zero and the range FIRST-LAST, not $1 and $2" >&2
        return 2
    }
    # Decimal, also with zeros in front.
    local first=$((${BASH_REMATCH[1]}10#${BASH_REMATCH[2]})) last=$((${BASH_REMATCH[3]}10#${BASH_REMATCH[4]})) from
    ((first <= last)) || {
        echo "$0: the range $2 ends before it begins" >&2
        return 2
    }
    for ((from = first; from <= last; from += $1)); do
        echo "$from $((from + $1 - 1 < last ? from + $1 - 1 : last))"
    done
}

name=${1:?usage: ${0##*/} NAME FRAMES OUT SCENE FIRST-LAST [arguments of drapery run]}
out=$3 scene=$4
chunks=$(frame_chunks "$2" "$5")
shift 5
