"""PyTorch and what it needs, in a folder of their own that the engine's environment leads to.

PyTorch alone takes more room than the engine, and most users do without it. In a folder of its own it can be added,
and fail to be added, while the engine stays as it is.
"""

from __future__ import annotations

import uuid
from dataclasses import replace

from . import places, requirements, state
from .problems import NoWheelError, SetupError
from .workshop import Workshop

_CHECK = "import torch; print(torch.__version__)"


def serves(shop: Workshop, before: state.State | None, now: state.State) -> bool:
    """Whether the network's packages that were in use serve the engine that is in use now."""
    return (
        before is not None
        and before.screening != ""
        and (shop.order.root / before.screening).is_dir()
        and before.python.split(".")[:2] == now.python.split(".")[:2]
        and before.screening_lock == state.digest(shop.order.screening_lock)
    )


def build(shop: Workshop, now: state.State) -> state.State:
    """Download, install and check the network's packages, and have the engine in use, ``now``, use them.

    Raises:
        SetupError: it could not be done; the engine is as it was.
    """
    order = shop.order
    shop.ask_for_room(order.screening_bytes)
    folder = order.root / f"{places.SCREENING}{uuid.uuid4().hex[:10]}"
    environment = order.root / now.environment
    lines: list[str] = []
    try:
        folder.mkdir()
        pip = shop.pip(environment, f"screening-{'.'.join(now.python.split('.')[:2])}")
        wanted = pip.applicable(requirements.read_lock(order.screening_lock))
        shop.download(pip, wanted, 5, 65)
        with shop.counted(folder, len(wanted), 65, 93):
            pip.install(wanted, folder, "Installing the screening's packages", folder)
        shop.report.progress(93, "Checking PyTorch")
        look = f"import sys; sys.path.append({str(folder)!r}); {_CHECK}"
        if shop.run([str(shop.interpreter(environment)), "-I", "-c", look], lines):
            raise shop.failed(lines, "Checking PyTorch")
        made = replace(now, screening=folder.name, screening_lock=state.digest(order.screening_lock))
        shop.use(made)
    except NoWheelError as error:
        shop.remove(folder)
        raise SetupError(f"{error} All but training and the network on points works without it.") from None
    except BaseException:
        shop.remove(folder)
        raise
    shop.say(f"Training and the network on points can be used: PyTorch {lines[-1]}, in {folder}.")
    return made
