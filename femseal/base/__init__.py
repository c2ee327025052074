"""Common ground of all rooms: errors, quantities with units, validation of input, display of results, files."""
