"""Ask a linktwin service from Python: `from backend.client import Linktwin`."""

from backend.client.linktwin import Linktwin
from backend.client.problem import ServiceProblem

__all__ = ["Linktwin", "ServiceProblem"]
