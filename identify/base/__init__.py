"""Common ground: errors, outcome, how numbers and progress are said, numerics that know nothing of friction."""
