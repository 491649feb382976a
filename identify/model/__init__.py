"""The stick-slip oscillator composed from effects: its equations, its modes, its resting rig in closed form."""
