// Many fingers at once on a GPU: one thread each takes STEPS steps. nvcc -O3 --fmad=false -I../../include batch.cu
// With --fmad=false the results are those of the CPU to the last bit.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

#include "../../src/<<p>>_kernels.c"
#include "../../src/<<p>>.c"

__global__ void step_many(<<p>>_state *states, const <<p>>_input *inputs, int *codes, int count, int steps, <<p>>_real h)
{
  const int at = blockIdx.x * blockDim.x + threadIdx.x;
  if (at >= count) return;
  <<p>>_model model;
  <<p>>_state state = states[at];
  int code = <<p>>_init(&model);<<if subject.forces>>
  <<p>>_forces forces = {};<<end>>
  for (int k = 0; k < steps && code >= 0; ++k) code = <<p>>_step(&model, &state, &inputs[at]<<if subject.forces>>, &forces<<end>>, h, &state);
  states[at] = state;
  codes[at] = code;
}

int main(int words, char **word)
{
  const int count = words > 1 ? std::atoi(word[1]) : 65536, steps = words > 2 ? std::atoi(word[2]) : 1000;
  const <<p>>_real h = <<h>>;
  std::vector<<<p>>_state> states(count);
  std::vector<<<p>>_input> inputs(count);
  std::vector<int> codes(count);
  std::memset(states.data(), 0, count * sizeof states[0]);
  std::memset(inputs.data(), 0, count * sizeof inputs[0]);
  for (int k = 0; k < count; ++k) inputs[k].<<first_input>> = <<level>> * k / count;
  <<p>>_state *on_states;
  <<p>>_input *on_inputs;
  int *on_codes;
  cudaMalloc(&on_states, count * sizeof states[0]);
  cudaMalloc(&on_inputs, count * sizeof inputs[0]);
  cudaMalloc(&on_codes, count * sizeof(int));
  cudaMemcpy(on_states, states.data(), count * sizeof states[0], cudaMemcpyHostToDevice);
  cudaMemcpy(on_inputs, inputs.data(), count * sizeof inputs[0], cudaMemcpyHostToDevice);
  step_many<<<(count + 127) / 128, 128>>>(on_states, on_inputs, on_codes, count, 1, h);
  cudaDeviceSynchronize();
  const auto start = std::chrono::steady_clock::now();
  step_many<<<(count + 127) / 128, 128>>>(on_states, on_inputs, on_codes, count, steps, h);
  if (cudaDeviceSynchronize() != cudaSuccess) return std::fprintf(stderr, "%s\n", cudaGetErrorString(cudaGetLastError())), 1;
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  cudaMemcpy(states.data(), on_states, count * sizeof states[0], cudaMemcpyDeviceToHost);
  cudaMemcpy(codes.data(), on_codes, count * sizeof(int), cudaMemcpyDeviceToHost);
  int failed = 0;
  for (int code : codes) failed += code < 0;
  std::printf("%d fingers, %d steps: %.3g s, %.3g steps/s; %d failed; last %s %.9g\n", count, steps, seconds,
              double(count) * steps / seconds, failed, "<<first_state>>", double(states[count - 1].<<first_state>>));
  return failed != 0;
}
