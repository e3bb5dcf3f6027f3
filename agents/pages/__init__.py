"""What the pages in the browser share: the drawing of scenes and the styles."""
