"""Two probes at one computer at the same time, each in a session of its own."""

from __future__ import annotations

import os
import subprocess

from patience import patient_command

from skinlab.cli.main import run
from skinlab.recording.session import read_session

SKINS = {"soft": 0.02, "stiff": 0.06}
PATIENCE_S = 300.0


def test_two_sessions_at_once_know_nothing_of_each_other(simulate, tmp_path, capsys):
    hosts = {}
    for name, x1 in SKINS.items():
        skin = tmp_path / f"{name}.toml"
        skin.write_text(
            f"[skin]\nX1_MPa = {x1}\nX2_MPa = 2.0\nnu = 0.3\n[probe]\nserial_number = '{name}'\n"
        )
        simulated = simulate("--tcp", "0", "--skin", str(skin), patient=True)
        hosts[name] = subprocess.Popen(
            patient_command(
                "skinlab", "measure", "--port", simulated.url, "--aperture-mm", "6",
                "--thickness-mm", "1", "--program", "ramp:100@50,ramp:0@50", "--repeats", "2",
                "--rest-s", "0.1", "--subject", f"P-{list(SKINS).index(name)}", "--site", "forearm",
                "--out", f"{name}.h5", apart=True,
            ),
            cwd=tmp_path, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
    for name, host in hosts.items():
        _, said = host.communicate(timeout=PATIENCE_S)
        assert host.returncode == 0, said
        assert run(["session", "verify", str(tmp_path / f"{name}.h5")]) == 0
    capsys.readouterr()
    both = {name: read_session(tmp_path / f"{name}.h5") for name in SKINS}
    begun = [session.records[0].utc_s for session in both.values()]
    ended = [session.records[-1].utc_s for session in both.values()]
    assert max(begun) < min(ended)  # so they did run at the same time
    found = {}
    for name, session in both.items():
        assert session.meta["instrument"]["serial_number"] == name
        assert session.meta["subject"] == f"P-{list(SKINS).index(name)}"
        assert [curve.partial for curve in session.curves] == [False, False]
        found[name] = session.results[0]["parameters"]["X1_MPa"]
        assert found[name]["low"] <= SKINS[name] <= found[name]["high"]
    assert found["soft"]["high"] < found["stiff"]["low"]
