"""What the add-in knows: reading a design, and turning what was read into a mechanism. Only `reader` meets Fusion."""
