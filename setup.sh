#!/usr/bin/env bash
# Installs what Photogram needs beside Rust, where it is missing: a linker, a Vulkan
# loader and a Vulkan driver. Debian and its kin. Touches no network when all is there.
set -euo pipefail

rust_needed=1.95

at_least() { # version, least
    [ "$(printf '%s\n' "$1" "$2" | sort -V | head -n 1)" = "$2" ]
}

has_loader() {
    PATH="$PATH:/usr/sbin:/sbin" ldconfig -p 2>/dev/null | grep 'libvulkan\.so\.1' >/dev/null
}

has_driver() {
    compgen -G '/usr/share/vulkan/icd.d/*.json' >/dev/null ||
        compgen -G '/etc/vulkan/icd.d/*.json' >/dev/null
}

if ! command -v cargo >/dev/null; then
    echo "setup: cargo is missing: install Rust $rust_needed or newer (rustup)" >&2
    exit 1
fi
rust=$(cargo --version | cut -d ' ' -f 2)
if ! at_least "$rust" "$rust_needed"; then
    echo "setup: Rust $rust is too old: $rust_needed or newer is needed (rustup update)" >&2
    exit 1
fi

packages=()
command -v cc >/dev/null || packages+=(gcc libc6-dev)
if [ "$(uname -s)" = Linux ]; then
    has_loader || packages+=(libvulkan1)
    has_driver || packages+=(mesa-vulkan-drivers)
fi
[ ${#packages[@]} -gt 0 ] || exit 0

root=()
if [ "$(id -u)" -ne 0 ] && command -v sudo >/dev/null; then
    root=(sudo)
elif [ "$(id -u)" -ne 0 ]; then
    echo "setup: neither root nor sudo: have these packages installed: ${packages[*]}" >&2
    exit 1
fi
if ! command -v apt-get >/dev/null; then
    echo "setup: no apt-get: install what your system calls these: ${packages[*]}" >&2
    exit 1
fi
echo "setup: installing ${packages[*]}" >&2
apt() { "${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq "$@" >/dev/null; }
apt update
apt install -y --no-install-recommends "${packages[@]}"
