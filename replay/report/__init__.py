"""Everything about some flights and a model, put together for one page."""
