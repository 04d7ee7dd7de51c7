"""Drives an environment by a policy in an ONNX file, without torch.

iout export runs/mine --onnx mine.onnx
python examples/onnx_policy.py mine.onnx paper/k10-fdd
"""

import sys

import numpy as np
import onnxruntime

from iout_marl import iout_v0

options = onnxruntime.SessionOptions()
options.log_severity_level = 3  # that the mask may be left out would be a warning
if len(sys.argv) != 3:
    sys.exit(f"usage: {sys.argv[0]} FILE.onnx SCENARIO")
session = onnxruntime.InferenceSession(sys.argv[1], options)
uses_mask = session.get_modelmeta().custom_metadata_map["trained_with_mask"] == "true"
names = {each.name for each in session.get_inputs()}
# A network for node tables sees them whatever the scenario shows to others.
changes = {"observation": "table"} if "nodes" in names else {}
changes["observation.action_mask"] = "info"
env = iout_v0.parallel_env(sys.argv[2], overrides=changes)
observations, infos = env.reset(seed=0)
while env.agents:
    seen = [observations[a] for a in env.agents]
    masks = np.stack([infos[a]["action_mask"] for a in env.agents]).astype(bool)
    if "nodes" in names:
        given = {name: np.stack([each[name] for each in seen]) for name in seen[0]}
        given["action_mask"] = masks
    else:
        given = {"observation": np.stack(seen).astype(np.float32)}
        if uses_mask:
            given["mask"] = masks
    (actions,) = session.run(["action"], given)
    observations, _, _, _, infos = env.step(dict(zip(env.agents, actions, strict=True)))
print(infos["auv_0"]["time_mean_aoi"])
