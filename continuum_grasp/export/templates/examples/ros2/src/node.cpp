// A simulated finger as a ROS 2 node: takes ~/input (<<subject.input.size>> numbers), publishes ~/state (<<subject.moving.nx>> numbers) at every step. The
// order of the numbers is that of the structs in <<p>>.h. Run-time parameters of the finger are parameters of the node,
// which may be set while it runs. After an error of the library it says so and stops stepping; warnings are said once.
#include <chrono>
#include <cstring>
#include <memory>
#include <stdexcept>

#include <rclcpp/rclcpp.hpp>
#include <std_msgs/msg/float64_multi_array.hpp>

#include <<<p>>.h>

class Node : public rclcpp::Node {
 public:
  using Numbers = std_msgs::msg::Float64MultiArray;

  Node() : rclcpp::Node("<<p>>"), h_(static_cast<<<p>>_real>(declare_parameter("step", <<subject.accurate_step>>)))
  {
    must(<<p>>_check());
    must(<<p>>_init(&model_));<<for struct, f in members>>
    declare_parameter("<<f.name>>", static_cast<double>(<<struct>>.<<f.name>>));<<end>>
    published_ = create_publisher<Numbers>("~/state", 10);
    taken_ = create_subscription<Numbers>("~/input", 10, [this](const Numbers &message) { take(message); });
    timer_ = create_wall_timer(std::chrono::duration<double>(h_), [this] { step(); });
  }

 private:
  static void must(int code)
  {
    if (code < 0) throw std::runtime_error(<<p>>_strerror(code));
  }

  void take(const Numbers &message)
  {
    if (message.data.size() != <<P>>_NU) {
      RCLCPP_ERROR(get_logger(), "input: expected %d numbers, got %zu", <<P>>_NU, message.data.size());
      return;
    }
    <<p>>_real numbers[<<P>>_NU];
    for (int k = 0; k < <<P>>_NU; ++k) numbers[k] = static_cast<<<p>>_real>(message.data[k]);
    std::memcpy(&input_, numbers, sizeof input_);
  }

  void step()
  {
<<if members>>    double value = 0;
<<for struct, f in members>>    if (get_parameter("<<f.name>>", value)) <<struct>>.<<f.name>> = static_cast<<<p>>_real>(value);
<<end>><<end>>    const int code = <<p>>_step(&model_, &state_, &input_<<if subject.forces>>, &forces_<<end>>, h_, &state_);
    if (code < 0) {
      RCLCPP_ERROR(get_logger(), "%s", <<p>>_strerror(code));
      timer_->cancel();
      return;
    }
    if (code > 0 && code != said_) RCLCPP_WARN(get_logger(), "%s", <<p>>_strerror(code));
    said_ = code;
    <<p>>_real numbers[<<P>>_NX];
    std::memcpy(numbers, &state_, sizeof state_);
    Numbers message;
    message.data.assign(numbers, numbers + <<P>>_NX);
    published_->publish(message);
  }

  <<p>>_model model_{};
  <<p>>_state state_{<<for value in start|, >><<value>><<end>>};
  <<p>>_input input_{};<<if subject.forces>>
  <<p>>_forces forces_{};<<end>>
  <<p>>_real h_;
  int said_ = 0;
  rclcpp::Publisher<Numbers>::SharedPtr published_;
  rclcpp::Subscription<Numbers>::SharedPtr taken_;
  rclcpp::TimerBase::SharedPtr timer_;
};

int main(int count, char **words)
{
  rclcpp::init(count, words);
  rclcpp::spin(std::make_shared<Node>());
  rclcpp::shutdown();
  return 0;
}
