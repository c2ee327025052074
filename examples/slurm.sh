#!/bin/bash
# Run femseal on the cores of a SLURM cluster. One job starts a Dask scheduler, a Dask worker for every task except one, and
# the femseal command, which distributes its work to the workers:
#   sbatch --nodes=2 --ntasks-per-node=32 examples/slurm.sh run CASE.toml -o FOLDER
# The command may be run, sweep or calibrate. Only the first node reads the case and writes the output folder. While the job
# runs, further jobs may add workers and remove them, if they can read the folder from which the job was submitted:
#   sbatch --array=1-16 --wrap "dask worker --scheduler-file dask-JOBID.json --nthreads 1 --death-timeout 60"
# Shortly before its time limit the command is stopped and the job is queued again, as SLURM does after the failure of a node.
# It then continues with the results in its folder.
#SBATCH --job-name=femseal
#SBATCH --cpus-per-task=1
#SBATCH --mem-per-cpu=2G
#SBATCH --time=08:00:00
#SBATCH --signal=B:TERM@120
#SBATCH --requeue
#SBATCH --open-mode=append
set -euo pipefail
connection="$PWD/dask-$SLURM_JOB_ID.json" # says where the scheduler is
rm -f "$connection"
dask scheduler --port 0 --no-dashboard --scheduler-file "$connection" &
until [ -s "$connection" ]; do sleep 1; done
address=$(python3 -c 'import json, sys; print(json.load(open(sys.argv[1]))["address"])' "$connection")

# one task remains for the scheduler and the command itself; if a node fails, the other workers take over its work
workers=$((SLURM_NTASKS - 1))
if [ "$workers" -gt 0 ]; then
    srun --ntasks="$workers" --no-kill --kill-on-bad-exit=0 \
        dask worker "$address" --nthreads 1 --no-dashboard --death-timeout 60 --local-directory /tmp &
fi

stopped=
trap 'stopped=yes; kill -TERM "$command"' TERM
femseal "$@" --scheduler "$address" --resume &
command=$! code=0
wait "$command" || code=$?
if [ "$stopped" ]; then
    wait "$command" || true # the first wait ended with the signal, not with the command
    scontrol requeue "$SLURM_JOB_ID"
fi
rm -f "$connection"
kill $(jobs -p) 2>/dev/null || true
exit "$code"
