#!/usr/bin/env bash
# Installs Chromium for the tests marked `browser`, as root through apt; does nothing where there is one or no apt.
# Those tests are then skipped, and the last line of `make test` says so (tests/conftest.py).
set -euo pipefail

for name in chromium chromium-browser google-chrome google-chrome-stable; do
  command -v "$name" >/dev/null && exit 0
done
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
  echo "setup: installing chromium for the tests in a browser" >&2
  { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends chromium; } \
    >/dev/null </dev/null || echo "setup: apt-get install chromium failed" >&2
fi
