"""How long JAX compiled: seconds, one entry a program, since the list was last cleared."""

import jax

COMPILING: list[float] = []


def _compiled(event: str, duration_secs: float, **_: str | int) -> None:
    if event.startswith("/jax/core/compile/"):
        COMPILING.append(duration_secs)


jax.monitoring.register_event_duration_secs_listener(_compiled)
