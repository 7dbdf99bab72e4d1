#!/bin/bash
# Submits a shot to Slurm as a chain of jobs, each with a chunk of the frames and a log of its own.
#
#   slurm_chunks.sh NAME FRAMES OUT SCENE FIRST-LAST [arguments of `drapery run`, but for --frames and --out]
#
# FRAMES is the number of frames in a chunk; 1 makes a job and a log of every frame, NAME.FRAMES.JOB.log. A job starts when the one before
# it is done, and resumes from the checkpoint at its end. If one fails, Slurm removes the jobs that wait for it. Submit the same again
# to continue: chunks that are done end at once.
#
# SBATCH="sbatch --partition=night --cpus-per-task=8" adds options of sbatch. Prints the numbers of the jobs.
set -euo pipefail
# shellcheck source=frame_chunks.sh
source "$(dirname "$0")/frame_chunks.sh"
read -r -a sbatch <<<"${SBATCH:-sbatch}"

after=()
while read -r from to; do
    # Every chunk asks for all frames up to its end: a finished range is extended, and nothing is simulated twice.
    job=$("${sbatch[@]}" --parsable --job-name="$name.$from-$to" "${after[@]}" "$(dirname "$0")/slurm.sbatch" "$out" "$scene" \
        --frames "${chunks%% *}-$to" "$@")
    echo "$job"
    # A job of several clusters is NUMBER;CLUSTER.
    after=(--dependency="afterok:${job%%;*}" --kill-on-invalid-dep=yes)
done <<<"$chunks"
