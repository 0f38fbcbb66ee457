"""What a folder of studies says: its claims, and the curves that they are judged by."""
