# shellcheck shell=bash
# Sourced by scripts/demo and scripts/test: finds or makes the virtual environment and installs into it.
# VLMB_VENV names another environment than .venv in the project.
set -euo pipefail
unset PYTHONPATH PYTHONHOME CDPATH # packages of another Python would come first

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
venv=${VLMB_VENV:-$root/.venv}
case $venv in /*) ;; *) venv=$PWD/$venv ;; esac
python=$venv/bin/python
read -r oldest beyond < <(sed -n 's/^requires-python = ">=3\.\([0-9]*\),<3\.\([0-9]*\)"$/\1 \2/p' "$root/pyproject.toml")
range="3.$oldest to 3.$((beyond - 1))"

say() { printf '%s\n' "$*"; }
fail() {
    printf 'error: %s\n' "$@" >&2
    exit 1
}

# Whether a command is a Python in the declared range that can import the given modules.
is_python() {
    local command=$1 modules=$2
    "$command" -c "import sys, $modules; sys.exit(not (3, $oldest) <= sys.version_info[:2] < (3, $beyond))" >/dev/null 2>&1
}

find_python() {
    local name
    for name in python3.11 python3.12 python3.10 python3.13 python3 python; do
        if is_python "$name" "venv, ensurepip"; then
            say "$name"
            return
        fi
    done
    fail "vlmb needs Python $range with its venv module, and none is on the PATH." \
        "Install one (on Debian or Ubuntu: apt install python3 python3-venv), or set VLMB_VENV to an environment that has one."
}

# What an installation depends on: the declared packages, the version, and where the project is.
installation_key() { printf '%s\n' "$root" | cat - "$root/pyproject.toml" "$root/vlmb/_version.py" | cksum; }

# prepare EXTRAS: afterwards $python runs vlmb with these extras. Needs the network only if something is to be installed.
prepare() {
    local extras=$1 key stamp found
    if ! is_python "$python" sys; then
        if "$python" -c pass 2>/dev/null; then
            fail "$venv has $("$python" -V), and vlmb needs $range; remove this folder and start again."
        fi
        if [ -e "$venv" ] && [ ! -e "$venv/pyvenv.cfg" ] && [ -n "$(ls -A "$venv")" ]; then
            fail "$venv is not a virtual environment; set VLMB_VENV to another folder."
        fi
        found=$(find_python)
        say "Making a virtual environment with $("$found" -V) in $venv"
        "$found" -m venv --clear "$venv"
    fi
    is_python "$python" pip || "$python" -m ensurepip >/dev/null
    key=$(installation_key)
    for stamp in "$venv/.vlmb-$extras" "$venv/.vlmb-test"; do
        if [ -e "$stamp" ] && [ "$(cat "$stamp")" = "$key" ]; then
            return
        fi
    done
    say "Installing vlmb with [$extras] into $venv (the first time some hundred MB; minutes on a slow network)"
    # without byte code of all of it, which takes as long as the rest: Python makes that of what it imports
    (cd "$root" && "$python" -m pip install -qq --no-compile --disable-pip-version-check --no-input -e ".[$extras]") ||
        fail "the installation failed; see above. It needs the network."
    printf '%s\n' "$key" >"$venv/.vlmb-$extras"
}

# warm: compile the engine, once on this machine, so that what runs side by side afterwards finds it compiled.
warm() { "$python" "$root/scripts/_warm.py"; }
