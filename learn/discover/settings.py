"""When a law is one."""

from dataclasses import dataclass


@dataclass(frozen=True)
class DiscoverySettings:
    """When a law is one. What half and twice of each does was not measured yet."""

    small: float = 0.03
    """What a typical law makes: this share of the weight, and of the weight at the vehicle's span as a torque. Sizes of
    coefficients follow from it; a hundred times as much is their limit."""
    alone: float = 0.1
    """The same of a law of one rotor alone, as a share of its thrust in hover."""
    p_value: float = 0.05
    """Share of residuals of chance in which as much is found as in the true one, up to which a law is one."""
    nulls: int = 99
    """Residuals of chance that are searched: with 99, the 95 % quantile is the fifth largest."""
    least_shift: float = 4.0
    """Shortest shift in time of such a residual [s]: longer than a vehicle's own motion remembers."""
    same: float = 0.995
    """Correlation of two atoms from which on the second is not tried."""
    feeding: float = 0.95
    """Share of the time in which a law of motion alone feeds it, from which on it follows a gust: a force along the
    velocity, or a torque along the rates, has all of it, one across them half."""
    most: int = 3
    """Laws in a row, each on what the last left."""
    equivalent: float = 3.0
    """Nats behind the best atom up to which another predicts the same."""
    stability: float = 0.8
    """Share of halves of the time in which the law, or one like it, is found again."""
    halves: int = 10
    """Such halves."""
    fewest: int = 6
    """Blocks of time below which a part of the flights has no coefficient of its own."""
    quarters: int = 4
    """Parts of the time, one after the other, that are held out where no flight is."""
    energy_reduction: float = 0.5
    """Share of the energy above the sensors' noise that laws take off time that they were not fitted to; less is no
    law: what hides there has a memory, or a form that is not among the atoms."""
    sure: float = 3.0
    """Standard deviations that the coefficients of a law are from zero, fitted with everything that was named."""
    apart: float = 3.0
    """Standard errors by which the coefficient of one part of the flights may differ from the mean, besides half of
    that: laws are not exact, and parts are short."""


SETTINGS = DiscoverySettings()
