#!/usr/bin/env bash
# Opens dumps in the real Rerun viewer, of the version that the crate logs for, without a screen.
#
#   tests/viewer.sh
#       records the embedded scene and checks the dump: its structure, its size, that the viewer opens it without a
#       warning, and that every view shows its part
#   tests/viewer.sh picture DUMP TICK OUT.png [LAYER | X,Y | X,Y+POINTS]…
#       takes a picture of the viewer at a tick (or `last`), as the documentation shows it, with layers hidden or shown,
#       what lies at places of the picture selected, and the scene brought nearer by a wheel
#
# Needs python3 with venv, a Vulkan device (software will do: Debian's mesa-vulkan-drivers and libvulkan1) and PyPI,
# where the viewer comes from. Where one is missing, the check says so and passes. CIRCUMSPHERE_RERUN_VENV names a
# virtual environment that has the viewer and Pillow already, instead of a new one.
set -euo pipefail

# A dump that a reader may attach to a report; bytes.
largest_dump=30000000

repository="$(cd "$(dirname "$0")/.." && pwd)"
headless="$repository/tests/viewer/headless.py"
task="${1:-check}"
scratch="$(mktemp -d)"
trap 'rm -rf "$scratch"' EXIT

fail() {
    echo "tests/viewer.sh: $*" >&2
    exit 1
}

skip() {
    [ "$task" = check ] || fail "$*"
    echo "SKIPPED, the viewer is not tested: $*" >&2
    exit 0
}

# Runs a program that neither reads nor writes what the user has set up for Rerun.
private() {
    env -u XDG_CACHE_HOME -u XDG_CONFIG_HOME -u XDG_DATA_HOME \
        HOME="$scratch" XDG_RUNTIME_DIR="$scratch" RUST_LOG=warn "$@"
}

# The version of the viewer is that of the crate `rerun` in Cargo.lock.
locked_version() {
    awk '$0 == "name = \"rerun\"" { getline; gsub(/"/, "", $3); print $3 }' "$repository/Cargo.lock"
}

# Leaves an interpreter that has the viewer in $python, and the viewer in $rerun.
install_viewer() {
    local version="$1" reason
    command -v python3 >/dev/null || skip "there is no python3"
    if [ -n "${CIRCUMSPHERE_RERUN_VENV:-}" ]; then
        python="$CIRCUMSPHERE_RERUN_VENV/bin/python"
        [ -x "$python" ] || fail "CIRCUMSPHERE_RERUN_VENV names no virtual environment: there is no $python"
    else
        python="$scratch/venv/bin/python"
        python3 -m venv "$scratch/venv" >"$scratch/log" 2>&1 || skip "python3 has no venv (Debian: python3-venv)"
        # The viewer is a program of its own: what the package wants for logging from Python is left out.
        if ! "$python" -m pip install --quiet --disable-pip-version-check --retries 1 --timeout 20 --no-deps \
            "rerun-sdk==$version" pillow >"$scratch/log" 2>&1; then
            reason="$(tail -n 1 "$scratch/log")"
            skip "rerun-sdk $version cannot be installed from PyPI: $reason"
        fi
    fi
    "$python" "$headless" driver || skip "there is no Vulkan device (Debian: mesa-vulkan-drivers libvulkan1)"
    local installed
    installed="$("$python" -c 'import importlib.metadata; print(importlib.metadata.version("rerun-sdk"))')"
    [ "$installed" = "$version" ] || fail "the viewer is $installed, the crate logs for $version"
    rerun="$("$python" "$headless" program)"
    private "$rerun" analytics disable 2>/dev/null
}

check() {
    local dump="$scratch/embedded.rrd" bytes
    cargo run --manifest-path "$repository/Cargo.toml" --quiet --locked --features rerun --example replay -- \
        --rerun "$dump" >/dev/null
    bytes="$(wc -c <"$dump")"
    echo "the dump of the embedded scene has $bytes bytes"
    [ "$bytes" -lt "$largest_dump" ] || fail "the dump has $bytes bytes, not fewer than $largest_dump"
    private "$rerun" rrd verify "$dump"
    private "$rerun" rrd stats "$dump" >"$scratch/stats"
    sed -n '/^Overview/,/^$/p' "$scratch/stats"
    private timeout --foreground 600 "$python" "$headless" check "$dump"
}

install_viewer "$(locked_version)"
case "$task" in
    check) check ;;
    picture)
        [ $# -ge 4 ] || fail "usage: tests/viewer.sh picture DUMP TICK OUT.png [LAYER | X,Y | X,Y+POINTS]…"
        [ -f "$2" ] || fail "there is no dump $2"
        private timeout --foreground 120 "$python" "$headless" "$@"
        ;;
    *) fail "unknown task $task: check or picture" ;;
esac
