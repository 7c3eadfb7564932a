"""What every table of a scenario file is made of."""

from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict


class Table(BaseModel):
    """A table of the file: unknown keys and numbers that are not finite are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


def tuples(data: Any) -> Any:
    """The same data with its lists and arrays as tuples, which is how the tables hold them."""
    if isinstance(data, np.ndarray | np.generic):
        return tuples(data.tolist())
    if isinstance(data, dict):
        return {key: tuples(value) for key, value in data.items()}
    return tuple(tuples(value) for value in data) if isinstance(data, list | tuple) else data
