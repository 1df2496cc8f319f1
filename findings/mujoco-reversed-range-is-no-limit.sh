#!/bin/sh
# MuJoCo takes a joint whose range is written from high to low as a joint without limits.
#
# One expects: `range="70 -20"` is an error, as it is with `limited="true"`, or the same as `range="-20 70"`.
# What happens: the compiler infers `limited` from range[0] < range[1]; for a reversed range it infers none, and nothing is said. The range in the
#     compiled model stays in degrees beside others in radians. A range of one value, which should fix the joint, does the same.
# Whom it hurts: hands whose MJCF was written by hand or mirrored: fingers bend backwards through the palm, and grasps look possible that are not.
# Versions: mujoco 4.0.0 (3.17.0 is the same), numpy 2.4.6, Python 3.11. Date: 2026-11-30.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3.11}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check mujoco==4.0.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'END'
import mujoco

HAND = '<mujoco><worldbody><body><joint name="bend" RANGE/><geom size="0.1"/></body></worldbody></mujoco>'
RANGES = ('range="-20 70"', 'range="70 -20"', 'range="20 20"', 'range="70 -20" limited="true"')

seen = []
for text in RANGES:
    try:
        model = mujoco.MjModel.from_xml_string(HAND.replace("RANGE", text))
        seen.append(bool(model.jnt_limited[0]))
        print(f"{text}: limited {seen[-1]}, compiled range {model.jnt_range[0].round(3)}")
    except ValueError as error:
        seen.append(None)
        print(f"{text}: {str(error).splitlines()[0]}")
raise SystemExit(seen != [True, False, False, None])
END
