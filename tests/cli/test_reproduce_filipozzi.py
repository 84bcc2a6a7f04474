"""`wheelhop reproduce filipozzi`: chapters end to end, resumed settings, and what it refuses."""

import json
from functools import partial

import pytest
from typer.testing import CliRunner

from wheelhop.cli import app, reproduce_filipozzi
from wheelhop.io.report import FAILS, HOLDS, IN_PART
from wheelhop.studies.filipozzi import drives, maneuvers, noise, robustness
from wheelhop.studies.filipozzi.parts import PARTS
from wheelhop.studies.filipozzi.study import filipozzi_study

RUNNER = CliRunner(env={"COLUMNS": "160", "NO_COLOR": "1", "TERM": "dumb"})


def call(*arguments, status=0):
    result = RUNNER.invoke(app, ["reproduce", "filipozzi", *(str(a) for a in arguments)])
    text = result.stdout + result.stderr
    assert result.exit_code == status, text
    assert "Traceback" not in text
    return " ".join(text.split())


def test_a_chapter_end_to_end(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    alone = partial(filipozzi_study, parts=[part for part in PARTS if part.name == "design"])
    monkeypatch.setattr(reproduce_filipozzi, "filipozzi_study", alone)
    said = call("--quick", "--runs", 3, "--seed", 2, "--out", "out")
    assert "wrote report.html, report.md, results.json, and 4 files of figures in out" in said
    out = tmp_path / "out"
    content = json.loads((out / "results.json").read_text())
    assert content["settings"]["runs"] == 3
    assert content["settings"]["seed"] == 2
    assert content["settings"]["bandwidth"] == 30.0
    assert content["results"]["design"]["corner_frequency_Hz"] == pytest.approx(30.0, rel=0.02)
    assert "quick run" in (out / "report.md").read_text()
    assert (out / "figure_4.png").stat().st_size > 20_000


def test_every_part_has_its_own_name():
    names = [part.name for part in PARTS]
    assert names == ["coupling", "design", "mass", "maneuvers", "robustness", "noise"]
    assert len({part.title for part in PARTS}) == len(PARTS)


@pytest.mark.slow  # minutes, most of it compiling
def test_the_whole_study_end_to_end_and_resumed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    call("--quick", "--out", "out")
    out = tmp_path / "out"
    content = json.loads((out / "results.json").read_text())
    assert list(content["results"]) == [part.name for part in PARTS]
    verdicts = {f["claim"]: f["verdict"] for f in content["findings"]}

    def verdict(words):
        (found,) = [v for claim, v in verdicts.items() if words in claim]
        return found

    assert verdict("with anti-roll bars the quarter car cannot be used") == HOLDS
    assert verdict("captures the response of the tyre's force") == FAILS
    assert verdict("uninitialised, both observers converge") == HOLDS
    assert verdict("uncertain stiffness results in an offset") == HOLDS
    assert verdict("springs 50 % stiffer than believed") == HOLDS
    assert verdict("with wrong springs too the joint filter") == IN_PART
    assert verdict("standard deviation covers the error that wrong springs") == FAILS
    assert verdict("the Youla observer offers better noise rejection") == HOLDS
    assert verdict("on a class C road with datasheet sensors") == HOLDS
    # m_s g (1 / 1.5 - 1) of the front corners' 4576 N
    robust = content["results"]["robustness"]
    free = robust["stiffness"]["from the free spring"]["1.5"]["Youla"]
    assert free["offset"] == pytest.approx(-4576.0 / 3.0, rel=0.05)
    assert robust["stiffness_joint"]["1"]["steady"] == pytest.approx(0.0, abs=20.0)
    assert "Fig. 10" in (out / "report.md").read_text()

    def computed(*arguments, **options):
        raise AssertionError("computed again")

    for module, name in (
        (drives, "simulate"),
        (maneuvers, "estimates"),
        (robustness, "observed"),
        (robustness, "wheel_loads"),
        (noise, "_measured"),
    ):
        monkeypatch.setattr(module, name, computed)
    call("--quick", "--out", "out")
    again = json.loads((out / "results.json").read_text())
    for part in ("maneuvers", "robustness", "noise"):
        assert again["results"][part] == content["results"][part]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--table", 3), "--table: 3 of filipozzi is not reproduced by itself"),
        (("--runs", 1), "--runs: 1 runs is outside 2"),
        (("--noise", 1), "--noise: the Filipozzi study has none"),
        (("--duration", 5), "--duration: the Filipozzi study has none"),
        (("--classes", "A"), "--classes: the Filipozzi study has none"),
    ],
)
def test_what_cannot_be_reproduced_is_refused_by_name(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert message in call(*arguments, status=2)
    assert not list(tmp_path.iterdir())
