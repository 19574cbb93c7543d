#!/bin/sh
# Measures the GPU of this machine, and keeps what was measured in results/ADAPTER beside this script. Needs a Vulkan driver.
#
#     ./run.sh              measures everything, at 1920x1080
#     ./run.sh --quick      small and few frames; other arguments, too, are passed on to frame_bench
set -u
here=$(CDPATH= cd -- "$(dirname -- "$0")" && pwd)
export BEVY_ASSET_ROOT="$here"
out="$here/results/unnamed"
mkdir -p "$out"
failed=""

# measure NAME COMMAND...: its output goes to the terminal and to NAME.txt, its log to NAME.log.
measure() {
    name=$1
    shift
    echo "=== $name"
    if "$@" >"$out/$name.txt" 2>"$out/$name.log"; then
        cat "$out/$name.txt"
    else
        echo "failed:"
        tail -n 5 "$out/$name.log"
        failed="$failed $name"
    fi
}

measure frames "$here/bin/frame_bench" --json "$out/frames.json" "$@"

# By the name that the first measurement found, so that results of several machines can lie side by side.
if [ -f "$out/frames.json" ]; then
    adapter=$(sed -n 's/^ *"adapter": "\(.*\)",$/\1/p' "$out/frames.json" | head -n 1 | tr -c 'A-Za-z0-9.\n' '_')
    if [ -n "$adapter" ]; then
        rm -rf "$here/results/$adapter"
        mv "$out" "$here/results/$adapter"
        out="$here/results/$adapter"
    fi
fi

for mesh in "$here"/meshes/*; do
    name=$(basename "$mesh")
    name="gpu_${name%.*}"
    measure "$name" "$here/bin/visfield" measure gpu --mesh "$mesh" --json "$out/$name.json"
done
measure paper2010 "$here/bin/visfield" measure paper2010 --mesh "$here"/meshes/* --json "$out/paper2010.json"

echo "results are in $out"
if [ -n "$failed" ]; then
    echo "failed:$failed"
    exit 1
fi
