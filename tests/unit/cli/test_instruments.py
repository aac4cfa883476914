"""Channels of instruments."""

from types import SimpleNamespace

import pytest

from app.cli import instruments


@pytest.mark.parametrize(
    ("wanted", "chosen"),
    [
        ("3", 3),
        ("0", 0),
        ("ZSensor", 3),
        ("", "several channels of heights; choose one by --channel: 0 Height, 2 Height, 3 ZSensor"),
        ("Height", "several have this name, choose by number; allowed: 0 Height, 2 Height, 3 ZSensor"),
        ("Phase", "it is no map of heights; allowed: 0"),
        ("1", "it is no map of heights; allowed: 0"),
        ("4", "there is none; allowed: 0"),
    ],
)
def test_channel_is_found_by_name_or_number(wanted, chosen):
    names = "Height", "Phase", "Height", "ZSensor"
    channels = [instruments.Channel(k, name, name != "Phase", None) for k, name in enumerate(names)]
    if isinstance(chosen, int):
        assert instruments.choose_channel(channels, wanted).index == chosen
        return
    with pytest.raises(ValueError, match=chosen):
        instruments.choose_channel(channels, wanted)


@pytest.mark.parametrize("unit", ["nm", ("nm", "V"), ("nm", None)])
@pytest.mark.parametrize("name", ["Height", "ZSensor", "Deflection", "AmplitudeRetrace", "Phase", "Lateral"])
def test_channels_of_heights_have_lengths_and_names(unit, name):
    """Deflection and amplitude may be lengths, too; a pair of units is that of another quantity."""
    channel = SimpleNamespace(index=3, name=name, unit=unit, is_height_channel=True)
    assert instruments._channel(channel).has_heights == (unit == "nm" and name in ("Height", "ZSensor"))
