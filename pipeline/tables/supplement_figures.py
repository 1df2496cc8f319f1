"""The supplement's figures, by class or configuration."""

PAPER = "Smith et al. 2020"  # the name of the paper and its supplement in tables
TABLE_1 = {"bottle": 71.8, "knife": 54.1, "cellphone": 67.2, "rifle": 53.6, "all": 62.7}  # per cent of touches that succeed
TOUCHES_PER_GRASP = (0.0, 9.47, 26.08, 53.83, 10.61)  # section 1.6: % of grasps with 0 to 4 touches; none printed for 0
TABLE_2 = {  # local Chamfer distance in the rings ×1 to ×5, m²
    "occluded": (6.687e-5, 5.938e-5, 5.305e-5, 5.038e-5, 4.841e-5),
    "occluded-touch": (2.569e-5, 2.970e-5, 3.257e-5, 3.393e-5, 3.528e-5),
    "unoccluded": (4.553e-5, 4.333e-5, 4.080e-5, 3.922e-5, 3.866e-5),
    "unoccluded-touch": (1.510e-5, 1.944e-5, 2.243e-5, 2.494e-5, 2.736e-5),
}
TABLE_3 = {  # Chamfer distance with 1 to 5 grasps, in the unit of Table 3 (about 9000 times m²)
    "unoccluded-touch": (0.804, 0.714, 0.689, 0.695, 0.654),
    "touch": (3.05, 1.769, 1.479, 1.296, 1.237),
}
BEST_EPOCH = {"occluded-touch": 113, "occluded": 114, "unoccluded-touch": 122, "unoccluded": 99, "touch": 90}
"""Section 3.3: the epoch whose weights were kept."""
TABLE_4: dict[str, tuple[float | None, float | None, float | None]] = {
    "N3MR": (2.629, 33.80, 47.72),  # the supplement prints an F1 of 3.80
    "3D-R2N2": (1.445, 39.01, 54.62),
    "PSG": (0.593, 48.58, 69.78),
    "MVD": (None, 66.39, None),
    "GEOMetrics": (None, 67.37, None),
    "Pixel2Mesh": (0.463, 67.89, 79.88),
    "Mesh R-CNN (pretty)": (0.391, 69.83, 81.76),
    "Mesh R-CNN (best)": (0.306, 74.84, 85.75),
    "Smith et al. 2020, charts": (0.369, 69.52, 82.33),
}
"""Chamfer distance × 1000 and F1 in % at tau and 2 tau of single images, None where it has none."""
