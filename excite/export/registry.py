"""The controller formats by name. A new one is one file beside this one and one line here."""

from __future__ import annotations

from excite.export.csv import CsvExporter
from excite.export.exporter import Exporter
from excite.export.npz import NpzExporter
from excite.export.ros2 import Ros2Exporter

EXPORTERS: dict[str, type[Exporter]] = {
    exporter.name: exporter
    for exporter in (
        CsvExporter,
        NpzExporter,
        Ros2Exporter,
    )
}
