"""The CAN bus as YAML."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal

from pydantic import model_validator

from twin_gait.configuration.sections import Section
from twin_gait.configuration.validation import Number, Strict, of_kind
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.network.dbc import find_dbc
from twin_gait.parameters import BOARDS, ImpedancePlace, NetworkParameters, Outage, parse_outage


class BoardNumbers(Strict):
    """A number for each board; what is not given is 0."""

    left_hip: Number = 0.0
    left_knee: Number = 0.0
    right_hip: Number = 0.0
    right_knee: Number = 0.0

    def convert(self) -> dict[str, float]:
        """Those that are not 0."""
        return {board: getattr(self, board) for board in BOARDS if getattr(self, board) != 0.0}

    @staticmethod
    def document(numbers: Mapping[str, float]) -> dict[str, float]:
        """As the mapping of a file."""
        return {board: numbers.get(board, 0.0) for board in BOARDS}


class NetworkEntry(Section):
    """The bus: ``ideal``, ``can``, or a mapping, which is of CAN unless its ``kind`` says otherwise."""

    parameters: ClassVar = NetworkParameters
    renamed: ClassVar[Mapping[str, str | None]] = {"kind": None}
    kind: Literal["ideal", "can"] = "can"
    bit_rate_kbit_per_s: Number | None = None
    bit_rate_bit_per_s: Number | None = None
    dbc: str = NetworkParameters.dbc
    cycle_ms: Number | None = None
    cycle_s: Number | None = None
    phase_us: BoardNumbers | None = None
    phase_s: BoardNumbers | None = None
    clock_drift_ppm: BoardNumbers | None = None
    clock_drift: BoardNumbers | None = None
    jitter_us: Number | None = None
    jitter_s: Number | None = None
    delay_ms: Number | None = None
    delay_s: Number | None = None
    loss: Number = NetworkParameters.loss
    error_share: Number = NetworkParameters.error_share
    bus_off_recovery: bool = NetworkParameters.bus_off_recovery
    impedance: ImpedancePlace = NetworkParameters.impedance
    board_silence_ms: Number | None = None
    board_silence_s: Number | None = None
    ccu_silence_ms: Number | None = None
    ccu_silence_s: Number | None = None
    outages: tuple[str, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _word_for_a_mapping(cls, value: Any) -> Any:
        return of_kind(value, "ideal, can")

    @model_validator(mode="after")
    def _ideal_has_no_parameters(self) -> NetworkEntry:
        given = sorted(self.model_fields_set - {"kind"})
        if self.kind == "ideal" and given:
            raise ValueError(f"ideal has no {given[0]}: set kind to can, or network to ideal as a whole")
        return self

    def values(self) -> dict[str, Any]:
        """Fields that are given, in SI."""
        return {**super().values(), "outages": tuple(map(_outage, range(len(self.outages)), self.outages))}

    def convert_in(self, folder: Path) -> NetworkParameters | None:
        """Convert, None for an ideal bus; a relative path is taken from the folder of the file."""
        if self.kind == "ideal":
            return None
        beside = folder / self.dbc
        dbc = str(beside.resolve()) if beside.is_file() else self.dbc
        try:
            find_dbc(dbc)
        except ParameterFileError as error:
            raise ParameterError(f"dbc: {error}") from error
        return NetworkParameters(**self.values() | {"dbc": dbc})

    @classmethod
    def document(cls, parameters: NetworkParameters) -> dict[str, Any]:
        """As the mapping of a file, in SI."""
        document = super().document(parameters)
        return {"kind": "can", **document, "outages": [str(outage) for outage in parameters.outages]}


def _outage(index: int, text: str) -> Outage:
    try:
        return parse_outage(text)
    except ParameterError as error:
        raise ParameterError(f"outages[{index}]: {error}") from error
