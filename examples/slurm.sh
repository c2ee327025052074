#!/bin/bash
# One case on the cores of several nodes, on a Dask cluster of its own. Submit with
#   sbatch examples/slurm.sh CASE.toml FOLDER
# FOLDER is on a file system that the first node sees; only its process reads and writes there. Shortly before the time
# limit the run is stopped and the job queued again; so it is after a node failed. It goes on from its checkpoint.
#SBATCH --job-name=femseal
#SBATCH --nodes=2
#SBATCH --ntasks-per-node=32
#SBATCH --cpus-per-task=1
#SBATCH --mem-per-cpu=2G
#SBATCH --time=08:00:00
#SBATCH --signal=B:TERM@120
#SBATCH --requeue
#SBATCH --open-mode=append
set -euo pipefail
case=$1 folder=$2

scratch=$(mktemp -d)
port=$((20000 + SLURM_JOB_ID % 20000))
address="tcp://$(hostname):$port"
dask scheduler --port "$port" --no-dashboard --scheduler-file "$scratch/scheduler.json" &
until [ -s "$scratch/scheduler.json" ]; do sleep 1; done
# one task is left to the scheduler and the run itself; of a node that fails, the others take the work
srun --ntasks=$((SLURM_NTASKS - 1)) --no-kill --kill-on-bad-exit=0 \
    dask worker "$address" --nthreads 1 --no-dashboard --local-directory /tmp &

femseal run "$case" -o "$folder" --scheduler "$address" --resume &
run=$!
stopped=
trap 'stopped=yes; kill -TERM "$run"' TERM
code=0
wait "$run" || code=$?
if [ "$stopped" ]; then
    wait "$run" || true # the first wait ended with the signal, not with the run
    scontrol requeue "$SLURM_JOB_ID"
fi
kill $(jobs -p) 2>/dev/null || true
rm -rf "$scratch"
exit "$code"
