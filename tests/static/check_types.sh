#!/bin/sh
# Checks the types of the page's modules (their JSDoc comments and the types.d.ts beside them) with TypeScript's compiler, by the settings in tsconfig.json.
# The compiler comes from Debian's packages, else from npm, where it is missing. Without any of them the check is skipped, and says so.
set -eu
cd "$(dirname "$0")/../.."
LOCAL=.cache/typescript
VERSION=5.8.3
PATH="$PWD/$LOCAL/node_modules/.bin:$PATH"

install_from_debian() {
    command -v apt-get >/dev/null 2>&1 && [ "$(id -u)" = 0 ] || return 1
    echo "installing node-typescript for the types of the page"
    need=node-typescript
    command -v node >/dev/null 2>&1 || need="$need nodejs"
    export DEBIAN_FRONTEND=noninteractive
    # shellcheck disable=SC2086
    { apt-get update -qq; apt-get install -y -qq --no-install-recommends $need; } >/dev/null 2>&1
}
install_from_npm() {
    command -v npm >/dev/null 2>&1 || return 1
    echo "installing typescript $VERSION for the types of the page"
    npm install --silent --no-fund --no-audit --prefix "$LOCAL" "typescript@$VERSION" >/dev/null 2>&1
}

command -v tsc >/dev/null 2>&1 || install_from_debian || install_from_npm || {
    echo "WARNING: TypeScript could not be installed: the types of the page were NOT CHECKED" >&2
    exit 0
}
exec tsc --project tsconfig.json
