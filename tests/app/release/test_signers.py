"""Whose signature a bundle carries, by the keys that were given or pinned."""

import json
import shutil

import pytest

from humanplay.release import signing
from humanplay.release.errors import ReleaseError
from humanplay.release.manifest import MANIFEST, PUBLIC_KEY
from humanplay.release.signing import check_signer, fingerprint_of, pin, read_pins
from tests.support.command import command


@pytest.fixture
def run(capsys):
    """`run(...)` runs the command and returns exit code and stdout."""

    def call(*args):
        code, out, err = command(capsys, *args)
        return code, out + err

    return call


COMMANDS = {
    "verify": lambda out, folder: ("verify", "--dataset", out),
    "import": lambda out, folder: ("import", out, "--database", folder / "new.db"),
    "reproduce": lambda out, folder: ("reproduce", out, "--recorded"),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_a_signer_is_not_checked_until_a_key_says_so_and_another_key_fails(
    published, tmp_path, run, name
):
    out, signer = published[0] / "out", published[1].signer
    args = COMMANDS[name](out, tmp_path)
    if name != "reproduce":  # which takes long: what it says without a key is in its own tests
        code, printed = run(*args)
        unchecked = f"signer not checked: nothing here says whose key {signer} is"
        assert (code, printed.count(unchecked)) == (0, 1)
        code, printed = run(*args, "--key", signer)
        assert (code, printed.count("signer checked"), "not checked" in printed) == (0, 1, False)
    code, printed = run(*args, "--key", "0" * 64)
    assert (code, "the signing key is" in printed, "signer checked" in printed) == (1, True, False)


def test_a_pinned_key_is_known_from_then_on(published, tmp_path, run, monkeypatch):
    out, signer = published[0] / "out", published[1].signer
    monkeypatch.setenv("HUMANPLAY_SIGNERS", str(tmp_path / "config" / "signers.json"))
    code, printed = run("verify", "--dataset", out, "--pin")
    assert (code, f"signer checked: {signer} is a pinned key" in printed) == (0, True)
    pinned = json.loads((tmp_path / "config" / "signers.json").read_text())
    assert pinned["signers"][signer]["study"] == "dunes"
    code, printed = run(*COMMANDS["verify"](out, tmp_path), "--key", out / PUBLIC_KEY)
    assert (code, "is the key that was given" in printed) == (0, True)
    code, printed = run(*COMMANDS["import"](out, tmp_path))
    assert (code, "is a pinned key" in printed) == (0, True)


def test_a_harmed_bundles_key_is_not_pinned(published, tmp_path, run):
    out = tmp_path / "out"
    shutil.copytree(published[0] / "out", out)
    (out / "scores.csv").write_text("nothing")
    assert run("verify", "--dataset", out, "--pin")[0] == 1
    assert not (tmp_path / "signers.json").exists()


def test_another_key_than_the_one_pinned_for_a_study_is_said(published, tmp_path):
    pins = tmp_path / "signers.json"
    manifest = json.loads((published[0] / "out" / MANIFEST).read_text())
    pin(pins, manifest)
    other = {**manifest, "signer": "ab" * 32}
    sentence = check_signer(other, None, pins).sentence()
    assert "signer not checked" in sentence
    assert f"it is not {manifest['signer']}, the key that is pinned for this study" in sentence
    pin(pins, other)
    assert set(read_pins(pins)) == {manifest["signer"], "ab" * 32}


def test_what_is_no_key_and_no_file_of_keys_is_a_sentence(published, tmp_path, run):
    with pytest.raises(ReleaseError, match="--key takes a fingerprint"):
        fingerprint_of("my key")
    assert fingerprint_of("AB12") == "ab12"
    key = signing.signing_key(tmp_path / "play.db")
    (tmp_path / "key.pem").write_bytes(signing.public_pem(key))
    assert fingerprint_of(str(tmp_path / "key.pem")) == signing.fingerprint(signing.public_pem(key))
    (tmp_path / "signers.json").write_text('{"format": "other"}')
    code, printed = run("verify", "--dataset", published[0] / "out")
    assert (code, "is no file of pinned keys" in printed) == (1, True)
    assert run("verify", "--pin")[0] == 2
