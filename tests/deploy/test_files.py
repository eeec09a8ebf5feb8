"""The files under deploy/ fit the software: settings, units and paths."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import tomllib
from contextlib import ExitStack
from pathlib import Path

import httpx
import pytest
import yaml

from humanplay.web.settings import Settings
from tests.support.browser import free_port
from tests.support.command_server import command_server
from tests.support.servers import PATIENCE_S, RunningServer
from tests.support.viewer3d import View

DEPLOY = Path(__file__).parents[2] / "deploy"
PYTHON = shutil.which("python3.11", path="/usr/local/bin:/usr/bin")
"""Where everybody may run it, as in the image."""
ENVIRONMENT = (DEPLOY / "systemd" / "humanplay.env").read_text()


def settings_of(pairs, monkeypatch):
    """Return the settings of environment variables; an unknown name fails."""
    for name, value in pairs.items():
        assert name.removeprefix("HUMANPLAY_").lower() in Settings.model_fields, name
        monkeypatch.setenv(name, value)
    return Settings()


def test_the_environment_of_the_unit_is_read_as_settings(monkeypatch):
    pairs = dict(re.findall(r"^#?(HUMANPLAY_\w+)=(.*)$", ENVIRONMENT, re.M))
    settings = settings_of(pairs, monkeypatch)
    assert settings.public_url == "https://mars.example"
    assert settings.trusted_proxies == ("127.0.0.1/32",)
    assert (settings.log_format, settings.metrics_host) == ("json", "127.0.0.1")
    assert settings.database.parent == settings.backup_to.parent


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze")
def test_systemd_reads_the_units(tmp_path):
    for name in ("humanplay.service", "humanplay.socket"):
        text = (DEPLOY / "systemd" / name).read_text()
        text = text.replace("/opt/humanplay/venv/bin/humanplay", "/bin/true")
        (tmp_path / name).write_text(text.replace("User=humanplay", "User=root"))
    units = [tmp_path / "humanplay.service", tmp_path / "humanplay.socket"]
    verify = ["systemd-analyze", "verify", "--man=no", *units]
    done = subprocess.run(verify, capture_output=True, text=True)
    complaints = (done.stdout + done.stderr).splitlines()
    assert [line for line in complaints if "humanplay" in line] == []


UNIT = (DEPLOY / "systemd" / "humanplay.service").read_text()
MOST_EXPOSED = 3.0
"""Of 10, by `systemd-analyze security`."""


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze")
def test_systemd_finds_little_that_the_unit_may_do(tmp_path):
    unit = tmp_path / "humanplay.service"
    unit.write_text(UNIT)
    command = ["systemd-analyze", "security", "--offline=true", "--no-pager", unit]
    done = subprocess.run(command, capture_output=True, text=True)
    (exposure,) = re.findall(r"Overall exposure level .*: ([\d.]+)", done.stdout)
    assert float(exposure) <= MOST_EXPOSED
    for ceiling in ("MemoryMax", "TasksMax", "CPUQuota", "StartLimitBurst"):
        assert re.search(rf"^{ceiling}=\S", UNIT, re.M), ceiling


def test_the_unit_does_not_try_again_with_a_wrong_setting():
    (code,) = re.findall(r"^RestartPreventExitStatus=(\d+)$", UNIT, re.M)
    serve = [sys.executable, "-m", "humanplay.cli", "serve"]
    wrong = {"env": os.environ | {"HUMANPLAY_PORT": "no number"}, "capture_output": True}
    assert subprocess.run(serve, **wrong).returncode == int(code)


def system_call_groups():
    """The groups of system calls that systemd knows, by name."""
    command = ["systemd-analyze", "syscall-filter", "--no-pager"]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    groups, members = {}, []
    for line in listed.splitlines():
        if line.startswith("@"):
            groups[line.strip()] = members = []
        elif line.strip() and not line.strip().startswith("#"):
            members.append(line.strip())
    return groups


def expanded(names, groups):
    """The system calls of a list in which groups begin with @."""
    calls = set()
    for name in names:
        calls |= expanded(groups[name], groups) if name.startswith("@") else {name}
    return calls


def calls_allowed():
    """The system calls that the unit's filter lets pass."""
    groups, allowed = system_call_groups(), set()
    for line in re.findall(r"^SystemCallFilter=(.*)$", UNIT, re.M):
        if line.startswith("~"):
            allowed -= expanded(line[1:].split(), groups)
        else:
            allowed |= expanded(line.split(), groups)
    return allowed


AS_ROOT = {"chown", "setgroups", "setresuid", "setresgid", "setuid", "setgid", "fchown"}
"""Calls of a server that root starts: its environments' processes become another user. The unit's user is not root."""


GUARDS = {"landlock_restrict_self", "unshare"}
"""Calls that keep boards to their files."""


def ended_episode(client):
    """The id of an episode that a move over the edge has ended."""
    board = client.post("/api/sessions", json={"size": [9, 13], "seed": 5}).json()
    frame = board["frame"]
    while frame["outcome"] is None:
        move = {"episode": frame["episode"], "step": frame["step"], "action": "north"}
        frame = client.post(f"/api/sessions/{board['session']}/act", json=move).json()
    return frame["episode"]


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze")
@pytest.mark.skipif(shutil.which("strace") is None, reason="NO STRACE: install it to see calls")
def test_the_unit_lets_pass_every_system_call_of_a_server_and_its_boards(tmp_path):
    counts = tmp_path / "counts"
    # with --seccomp-bpf only a call of interest stops the server: any that is not let pass
    others = "!" + ",".join(f"?{name}" for name in sorted(calls_allowed() - GUARDS))
    traced = ["strace", "-D", "-f", "-qq", "-c", "--seccomp-bpf", "-e", f"trace={others}"]
    serve = [sys.executable, "-m", "humanplay.cli", "serve", "--port", "0"]
    environments = ["--env", "mars", "--env", "FrozenLake-v1", "--env", "CartPole-v1"]
    files = ["--database", tmp_path / "a.db", "--backup-every", "60", "--backup-to", tmp_path / "b"]
    with (
        command_server([*traced, "-o", counts, *serve, *environments, *files]) as (_, address),
        httpx.Client(base_url=address, timeout=PATIENCE_S) as client,
    ):
        client.headers["Origin"] = address
        for root in ("", "/play/frozenlake-v1", "/play/cartpole-v1"):
            begun = client.post(f"{root}/api/sessions", json={})
            assert begun.status_code == 201, begun.text
        watched = client.post("/api/sessions", json={"player": "ppo", "size": [7, 9]})
        assert watched.status_code == 201
        with ExitStack() as stack:
            server = RunningServer(httpx.URL(address).port)
            assert View(server, watched.json()["session"], stack, client).read("/border")
        ended = f"/api/episodes/{ended_episode(client)}"
        assert client.get(f"{ended}/ghost?policy=frontier-cost").status_code == 200
        assert client.get("/api/export/episodes.csv").status_code == 200
    calls = set(re.findall(r"(\w+)$", counts.read_text(), re.M)) - {"syscall", "total", "errors"}
    assert calls >= GUARDS, "boards keep to their files"
    assert calls - AS_ROOT - GUARDS == set()
    assert calls_allowed() >= GUARDS


SERVE_LAKE = [
    *(sys.executable, "-m", "humanplay.cli", "serve"),
    *("--env", "FrozenLake-v1", "--port", "0"),
]
AS_THE_UNITS_USER = ["unshare", "--user", "--map-user=10001", "--map-group=10001"]


def guards_printed(folder, *before):
    """What a server prints of its guards that another user than root starts."""
    command = [*AS_THE_UNITS_USER, *before, *SERVE_LAKE, "--database", folder / "a.db"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    with subprocess.Popen(command, start_new_session=True, **pipes) as process:
        lines = []
        for line in process.stdout:
            lines.append(line)
            if "is open at" in line:
                break
        os.killpg(process.pid, signal.SIGTERM)
        assert process.wait(PATIENCE_S) == 0
    return lines[:-1]


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze")
@pytest.mark.skipif(shutil.which("strace") is None, reason="NO STRACE: install it to refuse calls")
@pytest.mark.skipif(
    subprocess.run([*AS_THE_UNITS_USER, "true"], capture_output=True).returncode != 0,
    reason="NO USER NAMESPACE: the server is not root's",
)
def test_boards_are_guarded_as_well_behind_the_filter_of_the_unit(tmp_path):
    others = "!" + ",".join(f"?{name}" for name in sorted(calls_allowed()))
    refused = ["-e", f"trace={others}", "-e", f"inject={others}:error=EPERM"]
    behind = guards_printed(tmp_path, "strace", "-f", "-qq", "-o", os.devnull, *refused)
    assert behind == guards_printed(tmp_path)
    assert "no network, no other files;" in behind[0]


def test_the_certificates_of_the_documents_are_taken_up_when_they_are_renewed():
    commands = re.findall(
        r"^certbot certonly .*$", (DEPLOY.parent / "docs/deploy.md").read_text(), re.M
    )
    assert commands
    assert all("--deploy-hook 'systemctl reload nginx'" in command for command in commands)


def test_the_compose_file_gives_settings_and_opens_the_ports_of_caddy_alone(monkeypatch):
    compose = yaml.safe_load((DEPLOY / "docker" / "compose.yaml").read_text())
    playground, caddy = compose["services"]["playground"], compose["services"]["caddy"]
    text = json.dumps(playground["environment"]).replace("${HUMANPLAY_ADMIN_PASSWORD:-}", "")
    variables = json.loads(
        text.replace("${HUMANPLAY_NAME:?the name that visitors open}", "mars.example")
    )
    settings = settings_of(variables, monkeypatch)
    (subnet,) = (network["subnet"] for network in compose["networks"]["inside"]["ipam"]["config"])
    assert settings.trusted_proxies == (subnet,), "Caddy's address, and nobody else's"
    assert "ports" not in playground
    assert caddy["ports"] == ["80:80", "443:443", "443:443/udp"]
    assert playground["build"]["dockerfile"] == "deploy/docker/Dockerfile"
    assert playground["read_only"] is True
    assert {"mem_limit", "pids_limit", "cpus"} <= set(playground)


def of_compose(folder, **settings):
    """Start what compose runs, in a folder and with settings of the test's own."""
    compose = yaml.safe_load((DEPLOY / "docker" / "compose.yaml").read_text())
    shell, option, script = compose["services"]["playground"]["command"]
    command = f"{sys.executable} -m humanplay.cli serve --env FrozenLake-v1"
    script = script.replace("$$", "$").replace("humanplay serve", command, 1)
    variables = {f"HUMANPLAY_{name}": str(value) for name, value in settings.items()}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    return subprocess.Popen(
        [shell, option, script], cwd=folder, env=os.environ | variables, **pipes
    )


@pytest.mark.parametrize("port", ["0", "no number"])
def test_a_container_whose_start_is_refused_waits_and_says_why(tmp_path, port):
    """It ends when it is told to, with a server or without."""
    with of_compose(tmp_path, PORT=port, DATABASE=tmp_path / "a.db") as process:
        lines = []
        for line in process.stdout:
            lines.append(line)
            if "is open at" in line or "docker compose restart playground" in line:
                break
        assert process.poll() is None
        process.terminate()
        code = process.wait(PATIENCE_S)
    if port == "0":
        assert code == 0, "the server has ended by itself"
    else:
        assert code == -signal.SIGTERM, "it has waited"
        assert "HUMANPLAY_PORT" in "".join(lines)
        assert "did not start" in lines[-1]


def test_the_image_runs_as_nobody_in_particular_and_copies_files_that_exist():
    root, lines = DEPLOY.parent, (DEPLOY / "docker" / "Dockerfile").read_text()
    assert lines.index("USER humanplay") < lines.index('CMD ["humanplay", "serve"]')
    not_ignored = set(re.findall(r"^!(.*)$", (root / ".dockerignore").read_text(), re.M))
    copies = re.findall(r"^COPY (?!--)(.*)$", lines, re.M)
    copied = [name for line in copies for name in line.split()[:-1]]
    assert set(copied) == not_ignored
    assert [name for name in copied if not (root / name).exists()] == []
    project = tomllib.loads((root / "pyproject.toml").read_text())
    included = project["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    assert [name for name in included if not name.startswith(tuple(copied))] == []


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.skipif(os.geteuid() != 0, reason="NO ROOT: the server of the image is another user")
@pytest.mark.skipif(PYTHON is None, reason="NO PYTHON 3.11 that another user can run")
def test_the_steps_of_the_image_run_without_a_container_engine():
    """Its files, variables, user, command and check; not its base, apt-get or useradd."""
    text = (DEPLOY / "docker" / "Dockerfile").read_text().replace("\\\n", " ")
    copies = [line.split() for line in re.findall(r"^COPY (?!--)(.*)$", text, re.M)]
    (install,) = re.findall(r"^RUN (python -m venv .*)$", text, re.M)
    (check,) = re.findall(r"^HEALTHCHECK .*?CMD (\[.*\])$", text, re.M)
    (command,) = re.findall(r"^CMD (\[.*\])$", text, re.M)
    variables = dict(re.findall(r"(\w+)=(\S+)", re.search(r"^ENV (.*)$", text, re.M)[1]))
    user, port = int(re.search(r"useradd --uid (\d+)", text)[1]), free_port()
    with tempfile.TemporaryDirectory() as folder:  # the image's user may enter it, unlike pytest's
        root, data = Path(folder), Path(folder) / "data"
        root.chmod(0o755)
        for *names, to in copies:
            for name in names:
                place = root / "src" / (name if to == "./" else to)
                place.parent.mkdir(parents=True, exist_ok=True)
                whole = DEPLOY.parent / name
                copy = shutil.copytree if whole.is_dir() else shutil.copy
                copy(whole, place)
        (root / "bin").mkdir()
        (root / "bin/python").symlink_to(PYTHON)
        base = {"PATH": f"{root}/bin:/usr/bin:/bin"}
        inherited = {
            key: value for key, value in os.environ.items() if not key.startswith("PYTHON")
        }
        install = install.replace("/opt/humanplay", f"{root}/venv")
        installation = subprocess.run(
            ["sh", "-c", install],
            cwd=root / "src",
            env=inherited | base,
            capture_output=True,
            text=True,
        )
        if "No matching distribution found for hatchling" in installation.stderr:
            pytest.skip("NO HATCHLING: the package registry cannot be reached")
        assert installation.returncode == 0, installation.stderr
        data.mkdir()
        os.chown(data, user, user)
        env = {key: value.replace("/data", str(data)) for key, value in variables.items()}
        env |= {"PATH": f"{root}/venv/bin:/usr/bin:/bin", "HUMANPLAY_PORT": str(port)}
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
        who = {"user": user, "group": user, "extra_groups": []}
        server = [f"{root}/venv/bin/{json.loads(command)[0]}", *json.loads(command)[1:]]
        with subprocess.Popen(server, cwd=data, env=env, **pipes, **who) as process:
            try:
                assert any("is open at" in line for line in process.stdout)
                asked = json.loads(check)
                asked[0] = f"{root}/venv/bin/{asked[0]}"
                assert subprocess.run(asked, env=env, **who).returncode == 0
            finally:
                process.terminate()
            assert process.wait(15) == 0, "as long as compose waits"
        assert (data / "playground.db").is_file()


def test_litestream_copies_the_database_of_the_unit():
    (database,) = yaml.safe_load((DEPLOY / "litestream.yml").read_text())["dbs"]
    assert f"HUMANPLAY_DATABASE={database['path']}\n" in ENVIRONMENT


def test_every_file_of_the_folder_is_named_in_the_document():
    document = (DEPLOY.parent / "docs" / "deploy.md").read_text()
    files = [path for path in DEPLOY.rglob("*") if path.is_file()]
    names = [path.relative_to(DEPLOY.parent).as_posix() for path in files]
    assert [name for name in names if name not in document] == []


@pytest.mark.skipif(shutil.which("strace") is None, reason="NO STRACE: install it to see calls")
def test_a_server_connects_to_nobody(tmp_path):
    """Neither for a page nor for a board."""
    calls = tmp_path / "calls"
    # with -D the process is the server, and strace is its child
    traced = ["strace", "-D", "-f", "-qq", "--seccomp-bpf", "-e", "trace=connect", "-o", calls]
    with command_server([*traced, *SERVE_LAKE, "--database", tmp_path / "a.db"]) as (
        process,
        address,
    ):
        with httpx.Client(base_url=address, timeout=PATIENCE_S) as client:
            assert client.get("/").status_code == 200
            assert client.post("/api/sessions", json={}).status_code == 201
        process.terminate()
        assert process.wait(PATIENCE_S) == 0
    to = re.findall(r'sin6?_addr.*?"([^"]+)"', calls.read_text())
    assert set(to) <= {"127.0.0.1", "::1"}
