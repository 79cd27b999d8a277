"""XMP of DJI's photographs."""

from streamkit_decoder.stills.xmp import read_fields


def test_attributes_and_elements_are_both_read() -> None:
    """XMP may write a value either way; signs and blanks are taken."""
    packet = b"""<rdf:Description drone-dji:GimbalPitchDegree="-90.00" drone-dji:AbsoluteAltitude='+12.5'
        tiff:Make="DJI"><drone-dji:FlightYawDegree> 8.5 </drone-dji:FlightYawDegree></rdf:Description>"""
    expected = {"GimbalPitchDegree": -90.0, "AbsoluteAltitude": 12.5, "FlightYawDegree": 8.5}
    assert read_fields(packet) == expected


def test_what_is_no_number_is_passed_over() -> None:
    """Words, other name spaces and an empty packet give nothing."""
    assert read_fields(b'drone-dji:Model="FC300S" exif:GpsLatitude="1.0"') == {}
    assert read_fields(b"") == {}
