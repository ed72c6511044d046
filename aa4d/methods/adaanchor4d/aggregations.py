"""The names of the ways to aggregate: settings are checked against them without torch."""

# The class of each, in aggregation.py.
AGGREGATIONS = {
    "product": "Product",
    "mean": "Mean",
    "anchor_only": "AnchorOnly",
    "time_only": "TimeOnly",
    "acfa": "AnchorConditioned",
}
