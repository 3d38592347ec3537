/* What calls are given, to begin with: a measurement of which nothing was measured (NaN), and the command that counts as
   applied before the first one. */
#define <<p>>_measurement_init(measurement) <<p>>_measurement_init_abi((measurement), <<P>>_ABI)
int <<p>>_measurement_init_abi(<<p>>_measurement *measurement, uint32_t abi);
#define <<p>>_command_init(command) <<p>>_command_init_abi((command), <<P>>_ABI)
int <<p>>_command_init_abi(<<p>>_command *command, uint32_t abi);

