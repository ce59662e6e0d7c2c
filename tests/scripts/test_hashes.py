"""What the set-up downloads is checked: packages by the hashes of the lock, Debian's by the archive's keys."""

from __future__ import annotations

import hashlib
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest


def wheel(folder: Path, text: str, name: str = "harmless", version: str = "1.0") -> Path:
    path = folder / f"{name}-{version}-py3-none-any.whl"
    info = f"{name}-{version}.dist-info"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr(f"{name}.py", text)
        file.writestr(f"{info}/METADATA", f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
        file.writestr(f"{info}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        file.writestr(f"{info}/RECORD", "")
    return path


def test_a_tampered_package_is_not_installed(shell, tmp_path: Path) -> None:
    environment, lock = tmp_path / "venv", tmp_path / "lock"
    subprocess.run([sys.executable, "-m", "venv", environment], check=True, timeout=600)
    sound = wheel(tmp_path, "").read_bytes()
    digest = hashlib.sha256(sound).hexdigest()
    lock.write_text(
        f"# A lock.\nharmless==1.0 \\\n    --hash=sha256:{digest}\nother==2.0 \\\n    --hash=sha256:{'0' * 64}\n"
    )
    install = f'LOCK="{lock}"; install_locked "{environment}" harmless -- --no-index --find-links "{tmp_path}"'
    wheel(tmp_path, "tampered = True")
    done = shell(install)
    assert done.returncode != 0
    assert "DO NOT MATCH THE HASHES" in done.stderr
    import_it = [environment / "bin" / "python", "-c", "import harmless"]
    assert subprocess.run(import_it, capture_output=True, check=False).returncode != 0
    (tmp_path / "harmless-1.0-py3-none-any.whl").write_bytes(sound)
    done = shell(install)
    assert done.returncode == 0, done.stderr
    subprocess.run(import_it, check=True)


def test_every_package_of_the_lock_has_hashes(root: Path) -> None:
    text = (root / "scripts" / "setup" / "requirements.lock").read_text(encoding="utf-8")
    entries = re.split(r"\n(?=[a-z])", text.partition("\n")[2].strip())
    assert len(entries) > 70
    for entry in entries:
        assert re.fullmatch(r"[a-z0-9.-]+==\S+( ; .*)?( \\\n    --hash=sha256:[0-9a-f]{64})+", entry), entry[:80]


def test_the_set_up_installs_packages_in_no_other_way(root: Path) -> None:
    """Except the checkout itself."""
    lines = [
        line.strip()
        for part in ("engine", "qgis", "profile", "pdal", "common")
        for line in (root / "scripts" / "setup" / f"{part}.sh").read_text(encoding="utf-8").splitlines()
        if "pip_in" in line and " install " in line
    ]
    unchecked = [line for line in lines if "--require-hashes" not in line]
    assert len(unchecked) == 1
    assert "--no-deps" in unchecked[0]
    assert '-e "$ROOT"' in unchecked[0]


@pytest.mark.parametrize("sound", [True, False])
def test_a_pytorch_whose_hash_is_not_listed_is_refused_and_the_set_up_goes_on(
    shell, checkout: Path, tmp_path: Path, sound: bool
) -> None:
    environment, lock = checkout / ".venv", tmp_path / "torch.lock"
    subprocess.run([sys.executable, "-m", "venv", environment], check=True, timeout=600)
    path = wheel(tmp_path, "__version__ = '2.7.0'", "torch", "2.7.0")
    digest = hashlib.sha256(path.read_bytes()).hexdigest() if sound else "0" * 64
    lock.write_text(f"torch==2.7.0 ; sys_platform == 'linux' \\\n    --hash=sha256:{digest}\n")
    done = shell(
        f'TORCH_LOCK="{lock}"; uname() {{ echo Linux; }}; setup_torch', PIP_NO_INDEX="1", PIP_FIND_LINKS=str(tmp_path)
    )
    assert done.returncode == 0, done.stderr
    assert ("PyTorch: 2.7.0 installed" in done.stdout) is sound, done.stdout
    assert ("refused, because the file's SHA-256 is not listed" in done.stdout) is not sound
    assert (checkout / ".setup" / "torch.missing").exists() is not sound
    there = subprocess.run([environment / "bin" / "python", "-c", "import torch"], capture_output=True, check=False)
    assert (there.returncode == 0) is sound


@pytest.mark.skipif(shutil.which("apt-get") is None, reason="there is no apt-get")
def test_packages_of_an_unsigned_mirror_are_not_taken(shell, tmp_path: Path) -> None:
    release = tmp_path / "mirror" / "dists" / "bullseye" / "Release"
    release.parent.mkdir(parents=True)
    release.write_text(
        "Origin: Debian\nSuite: oldoldstable\nCodename: bullseye\nComponents: main\nArchitectures: amd64\n"
    )
    done = shell(f'pdal_download "file:{tmp_path}/mirror" "{tmp_path}/work"')
    assert done.returncode != 0
    assert "not signed" in done.stderr or "keyring" in done.stderr, done.stderr
    assert not list((tmp_path / "work").rglob("*.deb"))
