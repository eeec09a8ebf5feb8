#!/bin/sh
# Chromium and nginx for the browser tests. Never fails: tests that need what is missing skip, and say so.
need=""
command -v chromium >/dev/null 2>&1 || command -v google-chrome >/dev/null 2>&1 || need="$need chromium"
command -v nginx >/dev/null 2>&1 || need="$need nginx"
[ -z "$need" ] && exit 0
if command -v apt-get >/dev/null 2>&1 && [ "$(id -u)" = 0 ]; then
    echo "installing$need for the browser tests"
    export DEBIAN_FRONTEND=noninteractive
    # shellcheck disable=SC2086
    { apt-get update -qq && apt-get install -y -qq --no-install-recommends $need fonts-dejavu-core; } >/dev/null 2>&1 && exit 0
fi
echo "WARNING:$need could not be installed: the tests that need it will be SKIPPED" >&2
exit 0
