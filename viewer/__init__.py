"""Shows flights and asks for work through a protocol of its own; knows neither learn nor compensate."""
