"""`wheelhop reproduce solmaz`: the paper's figures end to end, resumed, and what it refuses."""

import json
from functools import partial

import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from wheelhop.cli import app, reproduce_solmaz
from wheelhop.studies.solmaz import paper
from wheelhop.studies.solmaz.parts import PARTS
from wheelhop.studies.solmaz.study import solmaz_study

RUNNER = CliRunner(env={"COLUMNS": "160", "NO_COLOR": "1", "TERM": "dumb"})


def call(*arguments, status=0):
    result = RUNNER.invoke(app, ["reproduce", "solmaz", *(str(a) for a in arguments)])
    text = result.stdout + result.stderr
    assert result.exit_code == status, text
    assert "Traceback" not in text
    return " ".join(text.split())


def test_the_papers_simulation_end_to_end(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    alone = partial(solmaz_study, parts=[part for part in PARTS if part.name == "paper"])
    monkeypatch.setattr(reproduce_solmaz, "solmaz_study", alone)
    said = call("--quick", "--runs", 2, "--out", "out")
    assert "wrote report.html, report.md, results.json, and 8 files of figures in out" in said
    out = tmp_path / "out"
    content = json.loads((out / "results.json").read_text())
    assert content["settings"]["runs"] == 2
    assert "quick run" in (out / "report.md").read_text()
    verdicts = {f["claim"]: f["verdict"] for f in content["findings"]}
    within = "model 8, the soft front left tyre, is selected within 1 s of the onset of steering"
    assert verdicts[within] == "holds"

    found = content["results"]["paper"]
    assert 1.5 < found["largest_lateral_acceleration"] < 2.5
    methods = found["methods"]
    for name in ("as printed", "right turns corrected", "observer"):
        assert methods[name]["share_right_perfect"] == 1.0
        assert 0.0 <= methods[name]["right_for_good_after_onset_s"] < 0.1
    # the car turns right as its mirror image turns left: the printed models do not
    printed, corrected = (methods[n]["rms_error_and_signal"]["yaw rate"] for n in list(methods)[:2])
    assert printed[0] > 50 * corrected[0]
    assert corrected[0] < 1e-3 * corrected[1]
    assert methods["as printed"]["share_right_biased"] < 0.5
    assert methods["observer"]["share_right_biased"] == 1.0

    seven = pq.read_table(out / "figure_7.parquet").to_pydict()
    chosen = np.array(seven["selected"])
    costs = np.stack([seven[f"cost_{k}"] for k in range(1, 17)], axis=1)
    assert set(chosen[601:]) == {8}
    np.testing.assert_array_equal(np.argmin(costs[601:], axis=1) + 1, 8)
    assert set(chosen[:400]) == {16}
    nine = pq.read_table(out / "noise_and_bias.parquet").to_pydict()
    np.testing.assert_allclose(
        nine["bias_error_as_printed"], 0.05 / (120 / 3.6) * np.array(nine["time"]), atol=1e-4
    )

    def never(*args):
        raise AssertionError("computed again")

    monkeypatch.setattr(paper, "_driven", never)
    monkeypatch.setattr(paper, "_selected", never)
    call("--quick", "--runs", 2, "--out", "out")
    again = json.loads((out / "results.json").read_text())
    assert again["results"] == content["results"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--table", 3), "--table: 3 of solmaz is not reproduced by itself"),
        (("--runs", 1), "--runs: 1 runs is outside 2"),
        (("--noise", -1), "--noise: -1 m/s^2 is outside"),
        (("--duration", 5), "--duration: the Solmaz study has none"),
        (("--classes", "A"), "--classes: the Solmaz study has none"),
    ],
)
def test_what_cannot_be_reproduced_is_refused_by_name(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert message in call(*arguments, status=2)
    assert not list(tmp_path.iterdir())
