"""Shape ``-problem wedge -wedge_angle A``: a wedge along y."""

_CLASS = '''
@dataclass(frozen=True)
class Wedge(Shape):
    """A wedge along y with an `angle` [degrees] between its flanks and a plane."""

    angle: float

    name = "wedge"

    def distance(self, x, y):
        """Return the undeformed distance at points x, y [mm]."""
        return math.tan(math.radians(self.angle)) * np.abs(x) + 0 * y


@dataclass(frozen=True)
class FlatPunch(Shape):'''
_OPTION = (
    '    Option("wedge_angle", slant, REQUIRED, "angle between the flanks and the flat body [degrees]"),\n'
)
_MADE = '    "wedge": lambda options: shapes.Wedge(options["wedge_angle"]),\n'
CHANGES = {
    "app/problems/shapes.py": {"\n@dataclass(frozen=True)\nclass FlatPunch(Shape):": _CLASS},
    "app/cli/geometry_options.py": {
        '"roller", "cone")': '"roller", "cone", "wedge")',
        '    Option("punch_diameter"': f'{_OPTION}    Option("punch_diameter"',
    },
    "app/cli/geometry.py": {'    "punch": lambda options': f'{_MADE}    "punch": lambda options'},
}
