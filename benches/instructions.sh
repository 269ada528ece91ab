#!/usr/bin/env bash
# Instructions of one cold tick on a crumpled sheet, by valgrind's callgrind: each stage of the kernel by itself, and the
# whole plugin with each method. Unlike times they are the same on a busy machine. Valgrind knows no AVX-512: kernels that
# choose by the processor run as they do on AVX2.
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

# Prints "instructions function" for every function of the program's own, callees included. The tool lists a function once
# for each way in which its file is named: the first has all of it.
inclusive() {
    valgrind --tool=callgrind --callgrind-out-file="$folder/out" "$program" "$@" >"$folder/log" 2>&1 ||
        { cat "$folder/log" >&2; exit 1; }
    callgrind_annotate --inclusive=yes --threshold=99.99 "$folder/out" 2>/dev/null |
        sed -n 's/^ *\([0-9,]*\) ([ 0-9.]*%) *[^ ]*:stages::\([^ ]*\).*/\1 \2/p'
}

# Prints the count of every function whose name begins so, each once.
print_counts() {
    local seen=" " count name
    while read -r count name; do
        case "$name" in "$1"*::*) continue ;; "$1"*) ;; *) continue ;; esac
        case "$seen" in *" $name "*) continue ;; esac
        seen="$seen$name "
        printf '%18s  %s\n' "$count" "${2:-${name#"$1"}}"
    done
}

valgrind --version
echo "$triangles triangles"
echo "kernel, stage by stage:"
inclusive --once "$triangles" | print_counts kernel::
echo "whole cold tick of the plugin:"
for method in BoundingSphere Circumsphere Closest Exact Polygon; do
    inclusive --tick "$method" "$triangles" | print_counts cold_tick "$method"
done
