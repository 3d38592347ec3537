// The controller as a ROS 2 node: takes ~/measurement (<<loop.measurement.size>> numbers, NaN: not measured) and ~/reference (<<loop.stages.nr>> numbers, which
// hold for the whole horizon), publishes ~/command (<<loop.command.size>> numbers) every <<loop.period:.12g>> s. The order of the numbers is that of the
// structs in <<p>>.h. A measurement counts once: where none comes the controller notices, and falls back in the end.
// Weights, limits and penalties, and what is known of the finger, are parameters of the node, which may be set while it runs.
// Drives say on ~/applied (<<loop.command.size>> numbers) what they did, where that is not the last command.
#include <array>
#include <chrono>
#include <cmath>
#include <cstring>
#include <memory>
#include <stdexcept>

#include <rclcpp/rclcpp.hpp>
#include <std_msgs/msg/float64_multi_array.hpp>

#include <<<p>>.h>

class Node : public rclcpp::Node {
 public:
  using Numbers = std_msgs::msg::Float64MultiArray;

  Node() : rclcpp::Node("<<p>>_control")
  {
    must(<<p>>_check());
    must(<<p>>_controller_init(&controller_));
    measured_.fill(NAN);<<for struct, f in members>>
    declare_parameter("<<f.name>>", static_cast<double>(<<struct>>.<<f.name>>));<<end>>
    published_ = create_publisher<Numbers>("~/command", 10);
    measurements_ = create_subscription<Numbers>("~/measurement", 10, [this](const Numbers &message) {
      take(message, measured_, "measurement");
    });
    references_ = create_subscription<Numbers>("~/reference", 10, [this](const Numbers &message) {
      take(message, wanted_, "reference");
    });
    applied_ = create_subscription<Numbers>("~/applied", 10, [this](const Numbers &message) {
      std::array<<<p>>_real, <<loop.command.size>>> numbers{};
      if (!take(message, numbers, "applied")) return;
      <<p>>_command applied;
      std::memcpy(&applied, numbers.data(), sizeof applied);
      const int code = <<p>>_controller_applied(&controller_, &applied);
      if (code < 0) RCLCPP_ERROR(get_logger(), "applied: %s", <<p>>_strerror(code));
    });
    timer_ = create_wall_timer(std::chrono::duration<double>(<<loop.period:.12g>>), [this] { step(); });
  }

 private:
  static void must(int code)
  {
    if (code < 0) throw std::runtime_error(<<p>>_strerror(code));
  }

  template <class Array>
  bool take(const Numbers &message, Array &to, const char *name)
  {
    if (message.data.size() != to.size()) {
      RCLCPP_ERROR(get_logger(), "%s: expected %zu numbers, got %zu", name, to.size(), message.data.size());
      return false;
    }
    for (std::size_t k = 0; k < to.size(); ++k) to[k] = static_cast<<<p>>_real>(message.data[k]);
    return true;
  }

  void step()
  {
    <<p>>_measurement measurement;
    <<p>>_reference reference;
    <<p>>_command command;
    <<p>>_real rows[<<loop.stages.nr>>][<<loop.nodes>>];
    for (std::size_t j = 0; j < wanted_.size(); ++j)
      for (<<p>>_real &node : rows[j]) node = wanted_[j];
    std::memcpy(&reference, rows, sizeof reference);
    std::memcpy(&measurement, measured_.data(), sizeof measurement);
    measured_.fill(NAN);
<<if members>>    double value = 0;
<<for struct, f in members>>    if (get_parameter("<<f.name>>", value)) <<struct>>.<<f.name>> = static_cast<<<p>>_real>(value);
<<end>><<end>>    const int code = <<p>>_mpc(&controller_, &work_, &measurement, &reference, &command);
    if (code != said_) {
      if (code < 0) RCLCPP_ERROR(get_logger(), "%s", <<p>>_strerror(code));
      if (code > 0) RCLCPP_WARN(get_logger(), "%s", <<p>>_strerror(code));
      said_ = code;
    }
    if (code < 0) return; // what the drives do without a command is theirs to know
    <<p>>_real numbers[<<loop.command.size>>];
    std::memcpy(numbers, &command, sizeof command);
    Numbers message;
    message.data.assign(numbers, numbers + <<loop.command.size>>);
    published_->publish(message);
  }

  <<p>>_controller controller_{};
  <<p>>_controller_work work_{};
  std::array<<<p>>_real, <<loop.measurement.size>>> measured_{};
  std::array<<<p>>_real, <<loop.stages.nr>>> wanted_{<<wanted>>};
  int said_ = 0;
  rclcpp::Publisher<Numbers>::SharedPtr published_;
  rclcpp::Subscription<Numbers>::SharedPtr measurements_, references_, applied_;
  rclcpp::TimerBase::SharedPtr timer_;
};

int main(int count, char **words)
{
  rclcpp::init(count, words);
  rclcpp::spin(std::make_shared<Node>());
  rclcpp::shutdown();
  return 0;
}
