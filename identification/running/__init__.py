"""A fleet's machines side by side, on cores or on a Dask cluster."""
