"""Tables of the options of geometry and material."""

import numpy as np

from app.base.units import unit
from app.halfspace.grid import ONE_WAY, SYMBOLS
from app.options.option_table import (
    REQUIRED,
    Option,
    cells,
    choice,
    domain,
    flag,
    flag_or,
    from_zero,
    half,
    integer,
    length,
    length_from_zero,
    lengths,
    one_or_two_reals,
    pair,
    pair_of_reals,
    positive,
    real,
    series,
    subset,
    word,
)
from app.problems.roller import MAX_TILT
from app.problems.surfaces.height_map import TURNS
from app.problems.surfaces.reading import LEVELS, MISSING

AUTO = "auto"  # value of -domain
DEFAULT_CELLS = 256  # per side, of the default grid


grid_size = pair("nx,ny or n, whole numbers of at least 1")
frequencies = pair("M,N or M, whole numbers from 1 to 10000", highest=10000)
moduli = pair_of_reals("E1,E2, positive numbers; inf: a rigid body", above=0, highest=np.inf)
ratios = pair_of_reals("nu1,nu2, numbers from 0 to 0.5", lowest=0, highest=0.5)
of_coatings = one_or_two_reals("a positive number, or two of both bodies", above=0)
thicknesses = lengths(of_coatings)
ratios_of_coatings = one_or_two_reals("from 0 to 0.5, or two numbers of both bodies", lowest=0, highest=0.5)
resistivities = pair_of_reals("rho1,rho2, numbers of at least 0", lowest=0)
conductivities = pair_of_reals("k1,k2, positive numbers", above=0, highest=np.inf)
radii = lengths(
    pair_of_reals(
        "two numbers, not 0, or one for a ball; inf: straight; negative: concave",
        nonzero=True,
        highest=np.inf,
        one=True,
    )
)
slant = real("above 0, at most 89.9", above=0, highest=89.9)
tilt = real(f"from -{MAX_TILT} to {MAX_TILT}", lowest=-MAX_TILT, highest=MAX_TILT)
share = real("above 0, at most 1", above=0, highest=1)
hardness = real("a positive number; inf: elastic", above=0, highest=np.inf)


@lengths
def domain_or_auto(text):
    """Convert ``x0,x1,y0,y1`` to numbers; leave the word auto as it is."""
    return text if text == AUTO else domain(text)


MATERIAL_OPTIONS = [
    Option("contact_modulus", positive, REQUIRED,
        "E* of the pair [N/mm2]; or give -young and -poisson, or -shear_modulus and -poisson_ratio"),
    Option("young", moduli, REQUIRED, "E1,E2: Young's moduli of the two bodies [N/mm2]; inf: rigid"),
    Option("poisson", ratios, REQUIRED, "nu1,nu2: Poisson's ratios of the two bodies"),
    Option("shear_modulus", positive, REQUIRED, "combined G of the pair, 2/G = 1/G1 + 1/G2 [N/mm2]"),
    Option("poisson_ratio", half, REQUIRED, "combined nu, 2 nu/G = nu1/G1 + nu2/G2"),
    Option("coating_young", of_coatings, REQUIRED, "Young's modulus of the coating on body 1, or of both [N/mm2]"),
    Option("coating_poisson", ratios_of_coatings, REQUIRED, "Poisson's ratio of the coating"),
    Option("coating_thickness", thicknesses, REQUIRED, "thickness of the coating [mm]"),
    Option("resistivity", resistivities, None, "rho1,rho2, for electrical conductance; needs -stiffness [ohm m]"),
    Option("thermal_conductivity", conductivities, None, "k1,k2, for thermal conductance; needs -stiffness [W/(m K)]"),
    Option("relaxation_times", series, REQUIRED, "t1,t2,...: relaxation times; need -creep_times [s]"),
    Option("relaxation_moduli", series, REQUIRED, "g1,g2,...: shares of the modulus that relax; sum below 1"),
    Option("hardness", hardness, None, "upper bound of the pressure [N/mm2]; inf: elastic (default: none)"),
    Option("surface_compliance", from_zero, None, "displacement of a cell by its own pressure [mm3/N] (default: 0)"),
    Option("background_pressure", from_zero, None, "pressure in the gap, part of the load [N/mm2] (default: 0)"),
    Option("surface_compliance_file", word, None, "surface compliance (ny, nx): .npy, .npz, .h5[:/dataset] or text"),
    Option("hardness_file", word, None, "hardness (ny, nx): .npy, .npz, .h5[:/dataset] or text; inf: elastic"),
]  # fmt: skip
SHAPES = ("hertz", "punch", "file", "python", "rough", "sphere", "cylinder", "roller", "cone")
GEOMETRY_OPTIONS = [
    Option("problem", choice(*SHAPES), REQUIRED, "what is pressed together"),
    Option("grid", grid_size, REQUIRED, "nx,ny or n: cells (default: a file's, or 256)"),
    Option("domain", domain_or_auto, REQUIRED, "x0,x1,y0,y1: patch [mm] (default: a file's, or by theory), or auto"),
    Option("periodic", flag_or(*ONE_WAY), False, "the patch repeats in x and y, or in x or y only"),
    Option("periodic_symbol", choice(*SYMBOLS), SYMBOLS[0], "pressure is a sum of waves, or constant on each cell"),
    Option("hertz_rx", length, REQUIRED, "relative radius in x [mm]; or give -body1_radii and -body2_radii"),
    Option("hertz_ry", length, None, "relative radius of curvature in y [mm] (default: hertz_rx)"),
    Option("body1_radii", radii, REQUIRED, "hertz: radii of body 1, or one of a ball [mm]; inf: straight, -: concave"),
    Option("body2_radii", radii, REQUIRED, "hertz: radii of body 2 [mm]"),
    Option("body_angle", real(), 0.0, "hertz: from body 1's first axis to body 2's [degrees]"),
    Option("sphere_radius", length, REQUIRED, "radius, of two spheres the relative one, 1/R = 1/R1 + 1/R2 [mm]"),
    Option("cylinder_radius", length, REQUIRED, "radius of a cylinder lying along y [mm]"),
    Option("cylinder_length", length, None, "length of the cylinder [mm] (default: beyond the patch)"),
    Option("roller_radius", length, REQUIRED, "radius of a roller along y; on a raceway 1/(1/R1 + 1/R2) [mm]"),
    Option("roller_length", length, REQUIRED, "length of the roller, chamfers included [mm]"),
    Option("roller_end_chamfer", length_from_zero, 0.0, "axial length of a chamfer, where contact is impossible [mm]"),
    Option("roller_crown", choice("none", "log", "arc", "profile"), "none", "crown between the chamfers"),
    Option("roller_design_load", positive, None, "crown log: load with nearly uniform pressure (default: -load) [N]"),
    Option("roller_crown_radius", length, REQUIRED, "crown arc: radius [mm], or give its drop"),
    Option("roller_crown_drop", length, None, "crown arc: drop where the chamfers begin [mm]"),
    Option("roller_profile", word, REQUIRED, "crown profile: text file, y and drop z in mm on each line"),
    Option("roller_tilt", tilt, 0.0, "angle of the axis to the flat body; positive: more load at positive y [rad]"),
    Option("cone_angle", slant, REQUIRED, "angle between the cone's flank and the flat body [degrees]"),
    Option("punch_diameter", length, REQUIRED, "diameter of a flat punch at the origin [mm]"),
    Option("surface_seed", integer(0, "a whole number from 0"), 7, "seed of the random surface"),
    Option("surface_sigma", length_from_zero, 0.1, "the paper's surface: standard deviation of the heights [mm]"),
    Option("surface_decay", share, 0.8, "the paper's surface: gamma, decay of the amplitudes"),
    Option("surface_modes", frequencies, (12, 10), "the paper's surface: numbers of frequencies in x and y"),
    Option("surface_hurst", share, 0.8, "self-affine surface: Hurst exponent"),
    Option("surface_rolloff", length, None, "self-affine surface: roll-off wavelength [mm] (default: longer side)"),
    Option("surface_cutoff", length, REQUIRED, "self-affine surface: shortest wavelength [mm]"),
    Option("surface_rms_slope", from_zero, None, "self-affine surface: rms slope, instead of rms height"),
    Option("surface_rms_height", length_from_zero, None, "self-affine surface: rms height, instead of rms slope [mm]"),
    Option("surface_file", word, None, "measured heights, peaks positive: .npy, .npz, .h5[:/dataset], text or points"),
    Option("surface_file2", word, None, "measured heights of the other body, in the same x and y"),
    Option("surface_unit", unit, None, "unit of measured heights and points, if not stated in the file"),
    Option("surface_height_unit", unit, None, "unit of the heights, if it differs from that of x and y"),
    Option("surface_skip", integer(0, "a whole number from 0"), 0, "lines to skip at the head of a text file"),
    Option("surface_orient", subset(*TURNS), None, "flips and transpositions, applied first, in the given order"),
    Option("surface_level", choice(*LEVELS), "none", "what is subtracted from measured heights"),
    Option("surface_crop", cells, None, "i0,i1,j0,j1: use columns i0 to i1 - 1 and rows j0 to j1 - 1 only"),
    Option("surface_resample", flag, False, "interpolate measured heights to the cells of -grid and -domain"),
    Option("surface_missing", choice(*MISSING), "hole", "missing points (NaN): no contact there, or filled"),
    Option("surface_s_filter", length, None, "remove measured waves shorter than this, such as noise [mm]"),
    Option("surface_l_filter", length, None, "remove measured waves longer than this, such as waviness [mm]"),
    Option("gap_file", word, REQUIRED, "distance (ny, nx): .npy, .npz, .h5[:/dataset] or text; NaN: no contact"),
    Option("problem_type", word, REQUIRED, "python: module.Name or file.py:Name, a Problem or a function of x and y"),
]  # fmt: skip
COATING = "coating_young", "coating_poisson", "coating_thickness"
MATERIAL = ("contact_modulus", ("young", "poisson"), ("shear_modulus", "poisson_ratio"))
ROUGHNESS = ("surface_rms_slope", "surface_rms_height")
CROWN_ARC = ("roller_crown_radius", "roller_crown_drop")
RADII = (("hertz_rx", "hertz_ry"), ("body1_radii", "body2_radii", "body_angle"))
HARDNESS = ("hardness", "hardness_file")
COMPLIANCE = ("surface_compliance", "surface_compliance_file")
ALTERNATIVES = (CROWN_ARC, MATERIAL, HARDNESS, COMPLIANCE, ROUGHNESS, RADII)  # at most one of each
SURFACE_FILES = ("surface_file", "surface_file2")
FILES = (
    "gap_file",
    "hardness_file",
    "surface_compliance_file",
    "problem_type",
    "roller_profile",
    *SURFACE_FILES,
)
WAVY = ("surface_sigma", "surface_decay", "surface_modes")
SELF_AFFINE = ("surface_hurst", "surface_rolloff", "surface_cutoff", *ROUGHNESS)
