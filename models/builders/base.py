"""What a builder's file imports: the contract is in ``truepose.models.machine.builder``."""

from truepose.models.machine.builder import Builder, builders

__all__ = ["Builder", "builders"]
