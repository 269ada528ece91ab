#!/usr/bin/env bash
# Instructions of one cold tick on a crumpled sheet, by valgrind's callgrind: each stage of the kernel by itself, and the
# whole plugin with each method. Unlike times they are the same on a busy machine.
#
#   benches/instructions.sh [TRIANGLES]    default 20000
set -euo pipefail
cd "$(dirname "$0")/.."

triangles="${1:-20000}"
command -v valgrind >/dev/null || { echo "valgrind is not installed" >&2; exit 2; }
folder="$(mktemp -d)"
trap 'rm -r "$folder"' EXIT

program="$(cargo bench --bench stages --no-run --message-format=json 2>"$folder/cargo" |
    sed -n 's/.*"name":"stages".*"executable":"\([^"]*\)".*/\1/p' | tail -n 1)" || true
if [ -z "$program" ]; then
    cat "$folder/cargo" >&2
    exit 2
fi

# Prints "instructions function" for every function with more than a ten thousandth of them, callees included.
inclusive() {
    valgrind --tool=callgrind --callgrind-out-file="$folder/out" "$program" "$@" >"$folder/log" 2>&1 ||
        { cat "$folder/log" >&2; exit 1; }
    callgrind_annotate --inclusive=yes --threshold=99.99 "$folder/out" |
        sed -n 's/^ *\([0-9,]*\) ([ 0-9.]*%) *[^ ]*:\([^ ]*\).*/\1 \2/p'
}

valgrind --version
echo "$triangles triangles"
echo "kernel, stage by stage:"
inclusive --once "$triangles" | sed -n 's/^\([0-9,]*\) stages::kernel::\(.*\)/    \1 \2/p' |
    while read -r count name; do printf '%18s  %s\n' "$count" "$name"; done
echo "whole cold tick of the plugin:"
for method in BoundingSphere Circumsphere Closest Refined Polygon; do
    inclusive --tick "$method" "$triangles" | sed -n 's/^\([0-9,]*\) stages::cold_tick.*/\1/p' |
        while read -r count; do printf '%18s  %s\n' "$count" "$method"; done
done
