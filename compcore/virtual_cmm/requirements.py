"""What a virtual measurement must know: how sure the model is, and what its effects read."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.model.model import Model
from abbe.compcore.model.required_inputs import RequiredInputs
from abbe.compcore.virtual_cmm.part_program import PartProgram

F64 = NDArray[np.float64]


def known_covariance(model: Model, size: int) -> F64:
    """The covariance of a model's parameters, (p, p).

    Parameters
    ----------
    size
        How many parameters it has.

    Raises
    ------
    InputError
        When it has none: nothing could be drawn.
    """
    if not size:
        raise InputError(
            "the model is not fitted: it says nothing of how sure it is",
            expected="a model as abbe fit or abbe diagnose --apply write it",
        )
    if model.covariance is None:
        raise InputError(
            "the model has values without a covariance (imported, typed in, or changed since "
            "it was fitted): how sure they are is not known, and nothing can be drawn",
            expected="the model fitted to a campaign (abbe fit)",
        )
    if model.covariance.shape[0] != size:
        raise InputError(
            "the covariance is not that of the model's parameters", field="covariance",
            found=model.covariance.shape[0], expected=str(size),
        )  # fmt: skip
    return model.covariance


def require_stated(model: Model, program: PartProgram, needs: RequiredInputs) -> None:
    """Refuse a part program that does not state what the model reads.

    Raises
    ------
    InputError
        Naming the signals, the time, or an expansion of the part that is stated twice.
    """
    missing = [s for s in needs.signals if s not in program.signals]
    if missing:
        raise InputError(
            f"the model needs {', '.join(missing)}", field="signals",
            found=", ".join(program.signals) or "none",
            expected=" ".join(f"{s} = …" for s in missing) + " below [signals]",
        )  # fmt: skip
    if needs.clock and program.time is None:
        raise InputError(
            "the model needs the time: it has effects that grow or fade with it", field="time",
            expected="time = … (s since the start that the model was fitted with)",
        )  # fmt: skip
    expanding = [t for t in model.terms if t.fitted and t.effect.scope == "workpiece"]
    warmth = program.warmth
    if expanding and (warmth.expansion or warmth.expansion_sd):
        raise InputError(
            f"the model expands the workpiece itself ({expanding[0].effect.spec})",
            field="part.expansion", found=warmth.expansion * 1e6,
            expected="no expansion of the part, or a model without that effect",
        )  # fmt: skip
