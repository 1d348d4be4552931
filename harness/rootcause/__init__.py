"""Why a cell fails, found by experiment: cells measured one after another, each chosen by what came of those before."""
