#!/usr/bin/env bash
# Makes or renews .venv from requirements.lock; does nothing when it is up to date.
#
# PYTHON=/path/to/python3 chooses the interpreter (default: the one that .venv has, python3.11, or any python3 that is
# at least 3.11). The environment is renewed when the lock, pyproject.toml, its place or the interpreter changes.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

ENV=$PWD/.venv
STAMP=$ENV/wrenchgap-setup

say() { echo "setup: $*" >&2; }
fail() {
  say "$*"
  exit 1
}

runs() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; } # and is new enough
environment_works() { runs "$ENV/bin/python" && "$ENV/bin/python" -c 'import pip' 2>/dev/null; }

find_python() {
  local candidate
  if [ -n "${PYTHON:-}" ]; then
    runs "$PYTHON" || fail "PYTHON=$PYTHON does not run or is older than Python 3.11; give another"
    echo "$PYTHON"
    return
  fi
  if environment_works; then
    echo "$ENV/bin/python"
    return
  fi
  for candidate in python3.11 python3 python3.12 python3.13; do
    if runs "$candidate"; then
      command -v "$candidate"
      return
    fi
  done
  fail "no Python 3.11 or newer found; sudo apt-get install python3, or name one with PYTHON=/path/to/python3"
}

# Debian ships the standard library's venv without the pip that it puts into an environment.
can_make_venv() { "$1" -c 'import ensurepip, venv' >/dev/null 2>&1; }

venv_package() { # the default python3's package is python3-venv; another version has one of its own
  local version='import sys; print("%d.%d" % sys.version_info[:2])'
  local wanted default
  wanted=$("$1" -c "$version")
  default=$(/usr/bin/python3 -c "$version" 2>/dev/null || true)
  if [ "$wanted" = "$default" ]; then echo python3-venv; else echo "python$wanted-venv"; fi
}

ensure_venv_module() {
  can_make_venv "$1" && return
  local package
  package=$(venv_package "$1")
  if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    say "installing $package"
    { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$package"; } \
      >/dev/null </dev/null || true
  fi
  can_make_venv "$1" || fail "$1 cannot make virtual environments; run: sudo apt-get install $package"
}

fingerprint() {
  { cat requirements.lock scripts/pip.lock pyproject.toml scripts/setup_env.sh && echo "$ENV" && "$1" -VV; } | sha256sum | cut -d' ' -f1
}

python=$(find_python)
wanted=$(fingerprint "$python")
if [ "$(cat "$STAMP" 2>/dev/null)" = "$wanted" ] && "$ENV/bin/python" -c 'import numpy' 2>/dev/null; then
  exit 0
fi

started=$SECONDS
if ! environment_works || [ "$("$ENV/bin/python" -VV)" != "$("$python" -VV)" ]; then
  ensure_venv_module "$python"
  say "making .venv with $python"
  "$python" -m venv --clear "$ENV"
fi
rm -f "$STAMP"

pip() { "$ENV/bin/python" -m pip --disable-pip-version-check -qq "$@" </dev/null; }
say "installing the pinned versions of requirements.lock (a few minutes the first time)"
# What comes from the registry is what was locked, byte by byte: another file under the same name is refused.
pip install --require-hashes -r scripts/pip.lock # --build-constraint needs 25.3 or newer
pip install --require-hashes --build-constraint requirements.lock -r requirements.lock
pip install --no-build-isolation --no-deps -e . # hatchling is among what was locked
say "compiling what a first command would wait for (a minute; docs/decisions/0026-compiled-kernels.md)"
"$ENV/bin/python" scripts/warm_kernels.py
echo "$wanted" >"$STAMP"
say "done in $((SECONDS - started)) s"
