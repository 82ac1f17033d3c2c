"""The programs, and how they are solved."""
