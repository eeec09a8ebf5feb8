#!/bin/sh
# Chromium, nginx, openssl, the sqlite3 shell, strace and libfaketime for the tests. Never fails: tests that need what is missing skip, and say so.
# Chromium without windows is preferred, for it loads a page at half the cost; not every distribution has it.
has() { command -v "$1" >/dev/null 2>&1; }
has_faketime() { ls /usr/lib/*/faketime/libfaketime.so.1 >/dev/null 2>&1; }
add() { DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >/dev/null 2>&1; }

shell=chromium-headless-shell
need=""
has $shell || has chromium || has google-chrome || need="$need chromium"
has nginx || need="$need nginx"
has sqlite3 || need="$need sqlite3"
has openssl || need="$need openssl"
has strace || need="$need strace"
has_faketime || need="$need libfaketime"
if has apt-get && [ "$(id -u)" = 0 ]; then
    if [ -n "$need" ]; then
        echo "installing$need for the tests"
        apt-get update -qq >/dev/null 2>&1
        has nginx || add nginx libnginx-mod-stream || add nginx
        has sqlite3 || add sqlite3
        has openssl || add openssl
        has strace || add strace
        has_faketime || add libfaketime
        has $shell || has chromium || has google-chrome || add $shell fonts-dejavu-core || add chromium fonts-dejavu-core
    elif ! has $shell && apt-cache show $shell >/dev/null 2>&1; then
        echo "installing $shell for the browser tests"
        add $shell
    fi
fi
need=""
has $shell || has chromium || has google-chrome || need="$need chromium"
has nginx || need="$need nginx"
has sqlite3 || need="$need sqlite3"
has openssl || need="$need openssl"
has strace || need="$need strace"
has_faketime || need="$need libfaketime"
[ -z "$need" ] || echo "WARNING:$need could not be installed: the tests that need it will be SKIPPED" >&2
exit 0
