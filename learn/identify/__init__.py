"""Effects fitted to flights, searched for, added, put to the test on flights that were not fitted."""
