#!/usr/bin/env bash
# How long a game waits for this crate when nothing is compiled yet: processor time (user) of a build with the default
# features, and of one with only bevy_app, bevy_ecs, bevy_transform, and parry3d, which it needs.
#
#     benches/compile_time.sh [dev|release]
#
# Both builds start with an empty target folder and the versions of Cargo.lock. Nothing is downloaded while it is measured.
# Run it on a machine that does nothing else.
set -euo pipefail
cd "$(dirname "$0")/.."
repository="$PWD"
profile="${1:-dev}"

# Debug information is what a game has by default. A dependency from a registry has no incremental files.
export CARGO_INCREMENTAL=0
unset CARGO_PROFILE_DEV_DEBUG CARGO_PROFILE_RELEASE_DEBUG CARGO_TARGET_DIR RUSTFLAGS

folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT

# Makes a crate with these dependencies, as they stand in the manifest of this crate or as given.
crate() {
    local name="$1"
    mkdir -p "$folder/$name/src"
    touch "$folder/$name/src/lib.rs"
    cp Cargo.lock "$folder/$name/Cargo.lock"
    printf '[package]\nname = "%s"\nedition = "2024"\n\n[workspace]\n\n[dependencies]\n' "$name" >"$folder/$name/Cargo.toml"
    cat >>"$folder/$name/Cargo.toml"
    cargo fetch --quiet --manifest-path "$folder/$name/Cargo.toml"
}
grep -E '^(bevy_app|bevy_ecs|bevy_transform|parry3d) = ' Cargo.toml | crate needed
echo "bevy_circumsphere = { path = \"$repository\" }" | crate whole

# The user time of a build in seconds.
build() {
    local TIMEFORMAT='%U'
    { time cargo build --quiet --offline --profile "$profile" --manifest-path "$folder/$1/Cargo.toml" \
        --target-dir "$folder/$1/target" 2>&3; } 3>&2 2>&1
}
needed="$(build needed)"
whole="$(build whole)"
echo "profile $profile: bevy_app, bevy_ecs, bevy_transform, and parry3d ${needed} s; with bevy_circumsphere ${whole} s"
awk -v whole="$whole" -v needed="$needed" 'BEGIN { printf "ratio: %.2f\n", whole / needed }'
