# Frames of a shot in chunks, for scripts that source this file.

# frame_chunks FRAMES FIRST-LAST: the first and the last frame of each chunk of FRAMES frames, one chunk a line.
frame_chunks() {
    [[ $1 =~ ^[1-9][0-9]*$ && $2 =~ ^(-?[0-9]+)-(-?[0-9]+)$ ]] || {
        echo "$0: FRAMES is a number above zero and the range FIRST-LAST, not $1 and $2" >&2
        return 2
    }
    local first=${BASH_REMATCH[1]} last=${BASH_REMATCH[2]} from
    for ((from = first; from <= last; from += $1)); do
        echo "$from $((from + $1 - 1 < last ? from + $1 - 1 : last))"
    done
}
