"""A gait is one file: a new one is a setting, a command, on the page and in the schema without another line."""

import json
import subprocess
import sys
from pathlib import Path

NEW_GAIT = '''
import numpy as np
from snakeslam.gaits.gait import Gait
from snakeslam.gaits.parameters import USUAL_PERIOD, ParameterKind
from snakeslam.gaits.parametric import ParametricGait

LIFT = ParameterKind("lift_deg", "Lift", "deg", 0.5, 0.0, 30.0, "Amplitude of the pitch joints in degrees")


class Inchworm(Gait):
    """Pitch joints only."""

    name, title, summary = "inchworm", "Inchworm", "Humps its back; it cannot turn."
    parameters = (LIFT.between(1.0, 20.0, 8.0), USUAL_PERIOD)
    travels = "forward"

    def waves(self, values):
        """Return A_e = lift."""
        return ParametricGait(0.0, float(np.deg2rad(values["lift_deg"])), k_e=2 * np.pi / 16)

    def notice(self, waves):
        """Return that it humps."""
        return "It humps."


GAIT = Inchworm()
'''

USE = """
import json, sys
from snakeslam.gaits import forms
forms.__path__.append(sys.argv[1])
import pickle
from server.routes.gait import GaitRequest, _entry
from server.state import gait_state
from snakeslam.config import load_config
from snakeslam.config_file import sim_yaml
from snakeslam.control import Control
from snakeslam.gaits.catalogue import GAITS, resolve
from snakeslam.gaits.drawing import draw
from snakeslam.head.laws import effect
from snakeslam.messages import GaitCommand
from snakeslam.robot.model import PRESETS
from snakeslam.runtime.bus.codec import decode, encode

model = PRESETS["orthogonal24"]
config = pickle.loads(pickle.dumps(load_config(None, ["gait.name=inchworm", "gait.lift_deg=5"])))
control = Control(model, config.gait, config.head)
command = GaitCommand(0, "inchworm", parameters={"lift_deg": 6.0})
control.command(decode(GaitCommand, encode(command)))
for k in range(150):
    target = control.step(k * 10_000_000, None, None, None)
gait = resolve(config.gait, model)
print(json.dumps({
    "order": list(GAITS), "moved": bool(abs(target.q_rad).max() > 0.03), "notice": gait.notice,
    "drawn": draw(gait, model).points.shape, "state": gait_state(command).model_dump(),
    "entry": _entry(GAITS["inchworm"], model).model_dump(),
    "schema": GaitRequest.model_json_schema()["properties"], "yaml": sim_yaml(), "effect": effect("predictive", gait),
}))
"""


def test_a_file_is_all_that_a_gait_needs(tmp_path: Path, checkout: Path) -> None:
    (tmp_path / "inchworm.py").write_text(NEW_GAIT)
    said = subprocess.run(
        [sys.executable, "-c", USE, str(tmp_path)], cwd=checkout, capture_output=True, text=True, check=False
    )
    assert said.returncode == 0, said.stderr
    made = json.loads(said.stdout)
    assert made["order"][-1] == "inchworm"
    assert made["moved"]
    assert made["notice"] == "It humps."
    assert made["drawn"] == [32, 26, 3]
    assert (made["state"]["name"], made["state"]["lift_deg"], made["state"]["alpha_pi"]) == ("inchworm", 6.0, None)
    assert made["entry"]["parameters"][0] == {
        "key": "lift_deg", "label": "Lift", "unit": "deg", "min": 1.0, "max": 20.0, "step": 0.5, "default": 8.0,
    }  # fmt: skip
    assert "inchworm" in made["schema"]["name"]["enum"]
    assert "lift_deg" in made["schema"]
    assert "lift_deg: null" in made["yaml"]
    assert "Amplitude of the pitch joints in degrees (inchworm)." in made["yaml"]
    assert made["effect"].startswith("Feedback keeps the head level")
