"""Windows as elements: a window condensed to its sides, and the flow through runs of them."""
