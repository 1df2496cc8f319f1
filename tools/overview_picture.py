"""Draw the README's picture: what a report's first page shows of an object, and how the pretrained network reconstructs it.

    vt-pipeline report data/toy/draft --shipped
    python -m tools.overview_picture data/toy/draft OBJECT docs/overview.png

OBJECT is one of the test split, in its first grasp.
"""

import sys
from pathlib import Path

from pipeline.contrib.report.figures import overview_panels
from pipeline.contrib.report.report_source import ReportSource
from tools.picture_row import draw_row


def draw_overview(data: Path, object_id: str, path: Path) -> None:
    """Draw an object of the test split in two rows of pictures, as a PNG; titles break after a colon or the network's name."""
    panels = overview_panels(ReportSource(data), object_id, 0)
    draw_row([(title.replace(": ", "\n").replace(", ", "\n", 1), image) for title, image in panels], path, columns=3, inches=2.6)


if __name__ == "__main__":
    draw_overview(Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3]))
