"""Units, labels and meanings of the numbers of solutions and load paths."""

from typing import NamedTuple

from app.base.units import choose_unit


class Quantity(NamedTuple):
    """Unit, label, meaning and symbol of a result."""

    unit: str = "1"
    label: str = ""
    meaning: str = ""
    symbol: str = ""


_APPROACH = "how far the bodies have moved towards each other"
# Numbers of a report, in its order.
REPORTED = {
    "load": Quantity("N", "load", "normal force", "F"),
    "approach": Quantity("mm", "approach", _APPROACH, "δ"),
    "mean_pressure": Quantity("N/mm2", "mean pressure", "load over the area of the patch"),
    "max_pressure": Quantity("N/mm2", "maximum pressure", "largest mean pressure of a cell"),
    "contact_area": Quantity("mm2", "contact area", "cells in contact times their area"),
    "mean_contact_pressure": Quantity("N/mm2", "mean pressure in contact", "load over contact area"),
    "contact_fraction": Quantity("1", "contact fraction", "share of the cells where contact is possible"),
    "contact_fraction_corrected": Quantity(
        "1", "contact fraction, corrected", "the same, corrected for its stepped boundary"
    ),
    "persson_fraction": Quantity(
        "1", "Persson's theory", "contact fraction at this mean pressure, E* and rms slope"
    ),
    "bush_gibson_thomas_fraction": Quantity("1", "Bush, Gibson and Thomas's", "the same for light loads"),
    "contact_cells": Quantity("1", "cells in contact"),
    "contact_patches": Quantity("1", "contact spots", "sets of contact cells connected by edges"),
    "largest_patch": Quantity("mm2", "largest contact spot"),
    "perimeter": Quantity("mm", "perimeter", "length of the faces between contact and no contact"),
    "semi_axis_major": Quantity(
        "mm", "larger semi-axis", "of the ellipse with the second moments of the contact"
    ),
    "semi_axis_minor": Quantity("mm", "smaller semi-axis"),
    "contact_extent_x": Quantity("mm", "extent of the contact in x", "from the first to the last cell"),
    "contact_extent_y": Quantity("mm", "extent of the contact in y"),
    "load_per_length": Quantity("N/mm", "load per length", "load over the length of the contact"),
    "half_length": Quantity("mm", "half length of the contact"),
    "half_width": Quantity("mm", "half width of the contact", "where it is widest"),
    "mean_half_width": Quantity("mm", "mean half width", "contact area over twice its length"),
    "line_load": Quantity("N/mm", "line load", "load over the length of the roller between its chamfers"),
    "line_pressure": Quantity(
        "N/mm2", "line pressure", "maximum of Hertz's line contact under the line load"
    ),
    "line_half_width": Quantity("mm", "Hertz's half width", "of the line contact under the line load"),
    "edge_factor": Quantity("1", "edge factor", "largest pressure near the ends over the line pressure"),
    "half_width_middle": Quantity("mm", "half width in the middle", "of the roller"),
    "half_width_lower_end": Quantity("mm", "half width at the lower end", "of the contact, in y"),
    "half_width_upper_end": Quantity("mm", "half width at the upper end", "of the contact, in y"),
    "tilt_x": Quantity("1", "tilt in x", "slope by which the undeformed distance is reduced"),
    "tilt_y": Quantity("1", "tilt in y"),
    "pressure_centre_x": Quantity("mm", "centre of pressure, x"),
    "pressure_centre_y": Quantity("mm", "centre of pressure, y"),
    "plastic_area": Quantity("mm2", "plastic area", "cells at the hardness times their area"),
    "plastic_fraction": Quantity("1", "plastic fraction", "share of the cells where contact is possible"),
    "persson_hardness_fraction": Quantity("1", "Persson's theory with hardness", "contact fraction"),
    "persson_plastic_fraction": Quantity("1", "Persson's theory, plastic", "share at the hardness"),
    "plastic_volume": Quantity("mm3", "plastic volume", "volume of the permanent indentation"),
    "mean_plastic_depth": Quantity("mm", "mean plastic depth", "permanent indentation, over the same cells"),
    "hardness": Quantity("N/mm2", "hardness", "largest pressure of a cell"),
    "largest_load": Quantity("N", "largest load", "all cells at the hardness"),
    "mean_gap": Quantity("mm", "mean gap", "over the cells where contact is possible"),
    "stiffness": Quantity("N/mm", "stiffness", "dF/dδ, change of the load with the approach", "dF/dδ"),
    "unloading_stiffness": Quantity(
        "N/mm", "unloading stiffness", "dF/dδ of the whole contact while it unloads"
    ),
    "conductance_width": Quantity(
        "mm", "conductance width", "diameter of a circular contact with the same conductance"
    ),
    "electrical_conductance": Quantity(
        "S", "electrical conductance", "without films; resistance = 1/conductance"
    ),
    "thermal_conductance": Quantity("W/K", "thermal conductance", "without gas in the gap and radiation"),
    "transmissivity_x": Quantity("mm3", "transmissivity in x", "of a uniform gap g: g³/12"),
    "hydraulic_aperture_x": Quantity("mm", "hydraulic aperture in x", "uniform gap of this flow"),
    "transmissivity_y": Quantity("mm3", "transmissivity in y"),
    "hydraulic_aperture_y": Quantity("mm", "hydraulic aperture in y"),
    "flow_error": Quantity("1", "error of the transmissivities", "proved, relative"),
    "time": Quantity("s", "time", "since the sudden load"),
    "sliding_distance": Quantity("mm", "sliding distance", "since the start"),
    "worn_volume": Quantity("mm3", "worn volume", "of both bodies, since the start"),
    "tangential_load": Quantity("N", "tangential load"),
    "tangential_displacement": Quantity("mm", "tangential displacement", "of distant points"),
    "tangential_stiffness": Quantity("N/mm", "tangential stiffness", "while the tangential load grows"),
    "stick_area": Quantity("mm2", "sticking area"),
    "slip_area": Quantity("mm2", "slipping area"),
    "dissipated_energy": Quantity("N mm", "dissipated energy", "of a full cycle of the tangential load"),
    "contact_modulus": Quantity("N/mm2", "contact modulus E*", "1/E* = (1 − ν₁²)/E₁ + (1 − ν₂²)/E₂"),
    "rms_height": Quantity("mm", "rms height", "of the undeformed distance about its mean"),
    "rms_slope": Quantity("1", "rms slope", "of the undeformed distance on this grid"),
}
QUANTITIES = REPORTED | {
    "indentation": Quantity("mm", "approach beyond first touch"),
    "moment_x": Quantity("N mm", "moment in x"),
    "moment_y": Quantity("N mm", "moment in y"),
    "major_axis_angle": Quantity("degree", "larger semi-axis from x"),
    "stiffness_by_differences": Quantity("N/mm", "stiffness by differences"),
    "seconds": Quantity("s"),
    "background_pressure": Quantity("N/mm2", "background pressure", "of a gas or a fluid in the gap"),
    "surface_compliance": Quantity(
        "mm3/N", "surface compliance", "displacement of a cell by its own pressure"
    ),
}


ESTIMATED = "load", "approach", "max_pressure", "contact_area"  # their grid errors are estimated


def unit_of(name):
    """Return the unit of a quantity by its name."""
    return QUANTITIES.get(name.removeprefix("analytic_"), Quantity()).unit


def label_of(name):
    """Return the label of a quantity by its name."""
    quantity = name.removeprefix("analytic_")
    label = QUANTITIES.get(quantity, Quantity()).label or quantity.replace("_", " ")
    return label if quantity == name else f"analytic {label}"


def scale_for_axis(largest, name):
    """Return a quantity's factor and label for an axis.

    Examples
    --------
    >>> scale_for_axis(0.02, "approach"), scale_for_axis(2e4, "load")
    ((1000.0, 'approach δ  [µm]'), (0.001, 'load F  [kN]'))
    """
    unit = unit_of(name)
    factor, shown = choose_unit(largest, unit)
    return factor, axis_label(name).replace(f"[{unit}]", f"[{shown}]")


def axis_label(name):
    """Return label, symbol and unit of a quantity, for a plot axis.

    Examples
    --------
    >>> axis_label("contact_area"), axis_label("load"), axis_label("work_units")
    ('contact area  [mm²]', 'load F  [N]', 'work units')
    """
    symbol, unit = QUANTITIES.get(name, Quantity()).symbol, unit_of(name).replace("2", "²").replace("3", "³")
    return f"{label_of(name)} {symbol}".rstrip() + (f"  [{unit}]" if unit != "1" else "")
