"""Clips with truth: motion from MuJoCo, pictures from rays; nothing here is shared with the tracker that reads them."""
