/* The end of an S-function that is generated as C: nothing to compile. */
