"""Does a compensation ever harm, and does feed-forward with feedback beat its parts: figures for docs/do-no-harm.md."""
