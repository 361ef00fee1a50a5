"""Laws that no catalogue has, hidden in flights of other engines, and flights without one, for `discover`."""
