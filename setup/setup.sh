#!/usr/bin/env bash
# Sets up everything that dealib needs: Debian's dolfinx, and .venv with the rest from PyPI.
# Idempotent: it prints a line for each thing it does, and nothing when all is there.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

packages=(
  ca-certificates gcc libc6-dev openmpi-bin
  python3-venv python3-dev python3-dolfinx-real python3-petsc4py-real python3-mpi4py
  python3-h5py python3-h5py-mpi python3-scipy libopenblas0-pthread
  libegl1 libegl-mesa0 libgl1 libglu1-mesa  # pyvista and Gmsh
  libfontconfig1 libxcursor1 libxft2 libxinerama1 libxrender1 libxi6 libxfixes3
)
stamp=.venv/.setup-done

say() { printf 'setup: %s\n' "$*"; }
fail() { printf 'setup: %s\n' "$*" >&2; exit 4; }

exec 9<setup/setup.sh
flock 9 || true # suites that begin together set up once

wanted() { cat pyproject.toml setup/setup.sh setup/constraints.py; /usr/bin/python3 --version; pwd; }

[ -x /usr/bin/python3 ] && [ -f "$stamp" ] && [ "$(wanted | cksum)" = "$(cat "$stamp")" ] && exit 0

command -v dpkg-query >/dev/null || fail "dealib needs Debian 12 or newer (or a system with its packages)"
missing=()
for package in "${packages[@]}"; do
  dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
done
if [ "${#missing[@]}" -gt 0 ]; then
  as_root=()
  if [ "$(id -u)" -ne 0 ]; then
    command -v sudo >/dev/null || fail "as root, first run: apt-get install ${missing[*]}"
    as_root=(sudo)
  fi
  say "installing ${#missing[@]} Debian packages (${missing[0]}, ...)"
  log=$(mktemp)
  {
    "${as_root[@]}" apt-get update -q &&
      "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
        apt-get install -q -y --no-install-recommends "${missing[@]}"
  } >"$log" 2>&1 || { tail -n 20 "$log" >&2; fail "apt-get failed, see $log"; }
  rm -f "$log"
fi

say "making .venv"
# the system's Python, whatever else is on the PATH: only it sees Debian's dolfinx
/usr/bin/python3 -m venv --system-site-packages --clear .venv
/usr/bin/python3 setup/constraints.py >.venv/constraints.txt

say "installing Python packages"
.venv/bin/python -m pip install --quiet --disable-pip-version-check --no-warn-conflicts \
  --constraint .venv/constraints.txt --editable '.[dev]' >.venv/pip.log 2>&1 ||
  { tail -n 20 .venv/pip.log >&2; fail "pip failed, see .venv/pip.log"; }

say "checking"
.venv/bin/python setup/constraints.py --check || exit 4

say "compiling the forms of the shipped configs"
OMP_NUM_THREADS=1 .venv/bin/python setup/compile_forms.py || exit 4

wanted | cksum >"$stamp"
say "done"
