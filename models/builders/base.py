"""What a builder's file imports: the contract is in ``truepose.models.builder``."""

from truepose.models.builder import Builder, builders

__all__ = ["Builder", "builders"]
