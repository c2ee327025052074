"""From a case to the input of the studies: its faces made, read and conditioned, its sizes checked."""
