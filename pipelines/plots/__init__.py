"""Pictures for papers and reports: the curves of trainings, and skills that switch."""
