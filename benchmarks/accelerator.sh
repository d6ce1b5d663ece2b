#!/bin/sh
# The batch of closed-loop flights and the monitor of many units on a GPU, and the same programs on
# two cores of the machine that holds it: `PYTHONPATH=src:benchmarks sh benchmarks/accelerator.sh OUT`
# writes a text and a JSON file for each into the folder OUT. At most four minutes.
out=${1:-.}
python=${PYTHON:-python3}
export JAX_COMPILATION_CACHE_DIR="${TMPDIR:-/tmp}/jax_cache"
two="taskset -c 0,1 env JAX_PLATFORMS=cpu"
rest="taskset -c 2-$(($(nproc) - 1))"

flights() {
    name=$1 limit=$2 where=$3
    shift 3
    timeout "$limit" $where "$python" benchmarks/flights.py --json "$out/$name.json" "$@" \
        >"$out/$name.txt" 2>&1 || echo "$name ended with $?" >>"$out/$name.txt"
    grep -v Warning "$out/$name.txt" | grep -v lattice_result_type | tail -n 8
}

flights two_cores 200 "$two" --count 500 2000 &
cores=$!
flights gpu_many 110 "$rest" --count 100000 --float32
flights gpu_few 60 "$rest" --count 1000 10000
flights gpu_rows 80 "$rest" --count 100000 --batch rows
for units in 10000 100000; do
    timeout 40 $rest "$python" benchmarks/monitor.py --units $units 2>&1 | tee -a "$out/monitor.txt"
done
wait $cores
timeout 40 $two "$python" benchmarks/monitor.py 2>&1 | tee -a "$out/monitor.txt"
