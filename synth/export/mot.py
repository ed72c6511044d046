"""mot/: tracks of boxes. visdrone.txt has the columns of VisDrone's MOT task, uavdt.txt those of UAVDT's ground truth.

VisDrone: frame, target, left, top, width, height, score, category, truncation, occlusion.
UAVDT (gt_whole): frame, target, left, top, width, height, out of view, occlusion, category. Frames count from 1.
"""

from synth.capture import Folder
from synth.export.annotations import Sighting, sightings
from synth.plan import Plan

# 0 is "ignored regions", 11 "others".
VISDRONE = {"pedestrian": 1, "bicycle": 3, "car": 4, "van": 5, "truck": 6, "bus": 9, "motorcycle": 10}
UAVDT = {"car": 1, "van": 1, "truck": 2, "bus": 3}


def files(plan: Plan, folder: Folder) -> dict[str, str]:
    """Texts by path inside the capture."""
    visdrone, uavdt = [], []
    for frame, _, seen in sightings(plan, folder):
        for one in seen:
            place = f"{frame.rank + 1},{one.member.id},{','.join(map(str, one.box))}"
            visdrone.append(f"{place},1,{VISDRONE[one.member.class_name]},{int(one.cut)},{_occlusion(one)}")
            if one.member.class_name in UAVDT:
                uavdt.append(f"{place},{1 + int(one.cut)},{1 + _occlusion(one)},{UAVDT[one.member.class_name]}")
    return {"mot/visdrone.txt": "".join(f"{line}\n" for line in visdrone),
            "mot/uavdt.txt": "".join(f"{line}\n" for line in uavdt)}  # fmt: skip


def _occlusion(one: Sighting) -> int:
    """0 none, 1 up to half of the box, 2 more (VisDrone's grades). A whole body fills about 0.9 of its corners' box."""
    return 0 if one.shown > 0.75 else 1 if one.shown > 0.5 else 2
