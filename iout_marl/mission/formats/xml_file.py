"""What the XML formats share."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from iout_marl.mission.legs import DEGREE_DIGITS, METRE_DIGITS


def add(parent: ET.Element, name: str, text: str = "", **attributes: str) -> ET.Element:
    """A new element at the end of another one."""
    element = ET.SubElement(parent, name, attributes)
    element.text = text or None
    return element


def degrees(value: float) -> str:
    """A latitude or longitude."""
    return f"{value:.{DEGREE_DIGITS}f}"


def height(depth_m: float) -> str:
    """The height at a depth, in m."""
    return f"{0.0 - depth_m:.{METRE_DIGITS}f}"


def document(root: ET.Element) -> str:
    """The text of a file."""
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}'
