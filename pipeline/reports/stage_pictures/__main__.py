"""Draw the picture of each stage that a dataset has been through; a stage that has not been run has none.

python -m pipeline.reports.stage_pictures data/toy/draft docs/pictures
"""

import sys
from pathlib import Path

from pipeline.reports.stage_pictures import draw_stages
from pipeline.store.storage import place

if __name__ == "__main__":
    draw_stages(place(sys.argv[1]), Path(sys.argv[2]))
