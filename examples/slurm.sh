#!/bin/bash
# One case on many cores of a SLURM cluster, in one of two ways. Parts, one for each job of an array, which start as cores
# become free, and then a run that writes the results:
#   jobs=$(sbatch --parsable --array=1-16 examples/slurm.sh CASE.toml FOLDER)
#   sbatch --dependency=afterok:$jobs --wrap "femseal run CASE.toml -o FOLDER --resume"
# Or a Dask cluster of its own, one large job:
#   sbatch --nodes=2 --ntasks-per-node=32 examples/slurm.sh CASE.toml FOLDER
# FOLDER is on a file system that all nodes see; with Dask only the first node reads and writes there. Shortly before the time
# limit the work is stopped and the job queued again; so it is after a node failed. It goes on from its checkpoint.
#SBATCH --job-name=femseal
#SBATCH --cpus-per-task=1
#SBATCH --mem-per-cpu=2G
#SBATCH --time=08:00:00
#SBATCH --signal=B:TERM@120
#SBATCH --requeue
#SBATCH --open-mode=append
set -euo pipefail
case=$1 folder=$2
stopped=
trap 'stopped=yes; kill -TERM "$run"' TERM

# Run a command; its exit code is in $code. A signal of the time limit goes on to it.
follow() {
    "$@" &
    run=$! code=0
    wait "$run" || code=$?
    if [ "$stopped" ]; then
        wait "$run" || true # the first wait ended with the signal, not with the run
    fi
}

if [ "${SLURM_ARRAY_TASK_ID:-}" ]; then
    follow femseal run "$case" -o "$folder" --part "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT" --workers 1
else
    scratch=$(mktemp -d)
    port=$((20000 + SLURM_JOB_ID % 20000))
    address="tcp://$(hostname):$port"
    dask scheduler --port "$port" --no-dashboard --scheduler-file "$scratch/scheduler.json" &
    until [ -s "$scratch/scheduler.json" ]; do sleep 1; done
    # one task is left to the scheduler and the run itself; of a node that fails, the others take the work
    srun --ntasks=$((SLURM_NTASKS - 1)) --no-kill --kill-on-bad-exit=0 \
        dask worker "$address" --nthreads 1 --no-dashboard --local-directory /tmp &
    follow femseal run "$case" -o "$folder" --scheduler "$address" --resume
    rm -rf "$scratch"
fi
if [ "$stopped" ] || [ "$code" = 3 ]; then # 3: parts that are not under way come first, and need the cores
    scontrol requeue "$SLURM_JOB_ID"
fi
kill $(jobs -p) 2>/dev/null || true
exit "$code"
