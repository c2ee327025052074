"""What every room stands on: errors, quantities with units, validation of input, how results show themselves, files."""
