"""Files and folders that hold logs -> raw messages, whole or broken."""
