"""What parts and world both speak of: grid, links, ages, state."""
