"""Draw the picture of each stage that a dataset has been through; a stage that has not been run has none.

python -m tools.stage_pictures data/toy/draft docs/pictures [OBJECT]

OBJECT is one of the test split; without it, the one whose best grasp hides least.
"""

import sys
from pathlib import Path

from pipeline.store.storage import as_location
from tools.stage_pictures import draw_stages

if __name__ == "__main__":
    draw_stages(as_location(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:4])
