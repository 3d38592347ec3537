static const <<p>>_real <<name>>_inputs[] = {
<<inputs>>
};
static const <<p>>_real <<name>>_outputs[] = {
<<outputs>>
};
static const signed char <<name>>_codes[] = {<<codes>>};
static const bad_input <<name>>_bad[] = {
<<bad>>
};
static const bad_input <<name>>_spoilt[] = {
<<spoilt>>
};
