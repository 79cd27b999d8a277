from streamkit_media.decoding.videodecoder import accelerator


def test_software_where_no_device_is_wanted() -> None:
    """None asks for software and gets it without a reason."""
    assert accelerator("none") == (None, "software")


def test_an_unknown_device_falls_back() -> None:
    """A device this FFmpeg does not know is software, and says why."""
    assert accelerator("abacus") == (None, "software: abacus is not available here")


def test_auto_never_fails() -> None:
    """On any machine auto gives a device with its name, or software with the reason."""
    device, name = accelerator("auto")
    assert (device is None) == name.startswith("software")
