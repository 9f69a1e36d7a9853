"""Head control; its settings exist, its controllers come later."""
